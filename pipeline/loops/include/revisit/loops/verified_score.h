#pragma once

#include "revisit/recognition/calibration.h"

namespace revisit::pipeline {

/// Default calibration of Score::kVerified for ring descriptors: similarity of the descriptors plus
/// inlier ratio of the registration (Registration::inlier_ratio). The ratio is 0 if the similarity
/// is too low to register.
const Calibration& verified_calibration();

}  // namespace revisit::pipeline
