#include "revisit/baselines/baselines.h"
#include "revisit/recognition/optional_library.h"

// Replaces pcl/*.cpp in a build without PCL.

namespace revisit {

FeatureExtractor vfh_features(double) {
  built_without("feature vfh", "PCL");
}

FeatureExtractor grsd_features(double, double) {
  built_without("feature grsd", "PCL");
}

FeatureExtractor esf_features() {
  built_without("feature esf", "PCL");
}

}  // namespace revisit
