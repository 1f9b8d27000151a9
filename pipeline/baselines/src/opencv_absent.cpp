#include "revisit/baselines/visual_words.h"
#include "revisit/proto/error.h"

// Stands for visual_words.cpp in a build without OpenCV.

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail() {
  throw UsageError(
      "feature fabmap: this program was built without OpenCV; install libopencv-features2d-dev and "
      "build it with -DREVISIT_OPENCV=ON");
}

}  // namespace

FloatMatrix sift_descriptors(const GrayImage&) {
  fail();
}

FloatMatrix cluster_words(const FloatMatrix&, int, uint64_t) {
  fail();
}

void find_words(const FloatMatrix&, const FloatMatrix&, std::span<float>) {
  fail();
}

}  // namespace revisit::pipeline
