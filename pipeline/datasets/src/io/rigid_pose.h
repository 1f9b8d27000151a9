#pragma once

#include <span>
#include <string>

#include "revisit/datasets/pose.h"

namespace revisit {

/// Row-major 3x4 [R | t]. Throws InputError for a wrong count and if R is not a rotation.
Pose rigid_pose(std::span<const double> numbers, const std::string& where);

}  // namespace revisit
