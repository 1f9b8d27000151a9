#include "revisit/baselines/pcl_features.h"
#include "revisit/proto/error.h"

// Stands for pcl/*.cpp in a build without PCL.

namespace revisit::pipeline {
namespace {

[[noreturn]] void fail(const char* feature) {
  throw UsageError(str("feature ", feature,
                       ": this program was built without PCL; install libpcl-dev and build it with "
                       "-DREVISIT_PCL=ON"));
}

}  // namespace

FeatureExtractor vfh_features(const VfhOptions&) {
  fail("vfh");
}

FeatureExtractor grsd_features(const GrsdOptions&) {
  fail("grsd");
}

FeatureExtractor esf_features() {
  fail("esf");
}

}  // namespace revisit::pipeline
