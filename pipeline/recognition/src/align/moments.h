#pragma once

#include <array>
#include <cstddef>

namespace revisit::pipeline {

/// Sums over the returns among `points` [n][4] (x, y, z [m], unused) in double, in the same order.
struct FirstMoments {
  double count = 0;
  std::array<double, 3> sum{};  // of x, y, z, each minus that of `about`
};
FirstMoments first_moments(const float* points, size_t n, const std::array<double, 3>& about);

/// Of the products xx, xy, xz, yy, yz, zz of the same differences.
std::array<double, 6> second_moments(const float* points, size_t n,
                                     const std::array<double, 3>& about);

}  // namespace revisit::pipeline
