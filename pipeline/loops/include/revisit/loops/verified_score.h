#pragma once

#include "revisit/recognition/calibration.h"

namespace revisit {

/// Default calibration of Score::kVerified for ring descriptors: similarity plus
/// Registration::inlier_ratio, which is 0 if the similarity is too low to register.
const Calibration& verified_calibration();

}  // namespace revisit
