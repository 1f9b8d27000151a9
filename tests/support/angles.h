#pragma once

#include <numbers>

namespace revisit::test {

/// Angles in radians.
constexpr double kPi = std::numbers::pi, kTurn = 2 * kPi, kDegree = kPi / 180;

}  // namespace revisit::test
