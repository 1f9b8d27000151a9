#pragma once

#include <numbers>

namespace revisit::simulation {

inline constexpr double kDegree = std::numbers::pi / 180;  // [rad]

}  // namespace revisit::simulation
