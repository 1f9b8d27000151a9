#include "fabmap.h"
#include "revisit/baselines/baselines.h"
#include "revisit/recognition/optional_library.h"

// Replaces opencv/*.cpp in a build without OpenCV.

namespace revisit {

FloatMatrix sift_descriptors(const GrayImage&) {
  built_without("feature fabmap", "OpenCV");
}

FloatMatrix cluster_words(const FloatMatrix&, int, uint64_t) {
  built_without("feature fabmap", "OpenCV");
}

void find_words(const FloatMatrix&, const FloatMatrix&, std::span<float>) {
  built_without("feature fabmap", "OpenCV");
}

}  // namespace revisit
