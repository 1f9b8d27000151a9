#pragma once

#include <numbers>

namespace revisit::pipeline::simulation {

inline constexpr double kDegree = std::numbers::pi / 180;  // [rad]

}  // namespace revisit::pipeline::simulation
