#pragma once

#include "revisit/recognition/calibration.h"

namespace revisit::pipeline {

/// How likely a registered loop is right, by Score::kVerified: the similarity of the descriptors
/// plus the inlier ratio of the registration (Registration::inlier_ratio), 0 where the place is too
/// unlike to be registered. For ring descriptors.
const Calibration& verified_calibration();

}  // namespace revisit::pipeline
