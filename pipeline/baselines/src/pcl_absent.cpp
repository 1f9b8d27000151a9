#include "revisit/baselines/pcl_features.h"
#include "revisit/recognition/optional_library.h"

// Replaces pcl/*.cpp in a build without PCL.

namespace revisit {

FeatureExtractor vfh_features(const VfhOptions&) {
  built_without("feature vfh", "PCL");
}

FeatureExtractor grsd_features(const GrsdOptions&) {
  built_without("feature grsd", "PCL");
}

FeatureExtractor esf_features() {
  built_without("feature esf", "PCL");
}

}  // namespace revisit
