#pragma once

#include <array>
#include <cstddef>

namespace revisit {

/// Sums over the returns in `points` [n][4] (x, y, z [m], unused), in double and in a fixed order.
struct FirstMoments {
  double count = 0;
  std::array<double, 3> sum{};  // x, y, z minus `about`
};
FirstMoments first_moments(const float* points, size_t n, const std::array<double, 3>& about);

/// Sums the products xx, xy, xz, yy, yz, zz of the same differences.
std::array<double, 6> second_moments(const float* points, size_t n,
                                     const std::array<double, 3>& about);

}  // namespace revisit
