#pragma once

#include <calibration.pb.h>

#include <string>

#include "revisit/recognition/calibration.h"

namespace revisit {

void fill(const Calibration& from, ring::Calibration& to);
/// Throws InputError with `name` and the defect.
Calibration calibration_from(const ring::Calibration& from, const std::string& name);

}  // namespace revisit
