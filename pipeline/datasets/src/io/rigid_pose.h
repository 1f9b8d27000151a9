#pragma once

#include <span>
#include <string>

#include "revisit/datasets/pose.h"

namespace revisit::pipeline {

/// Of a row-major 3x4 [R | t]. Throws InputError, starting with `where`, for another count and when
/// R is no rotation.
Pose rigid_pose(std::span<const double> numbers, const std::string& where);

}  // namespace revisit::pipeline
