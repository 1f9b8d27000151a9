#pragma once

#include <array>
#include <cstddef>

namespace revisit {

/// Number of the returns in `points` [n][4] (x, y, z [m], unused), and sums of x, y, z minus
/// `about`, in double and in a fixed order.
std::array<double, 4> first_moments(const float* points, size_t n,
                                    const std::array<double, 3>& about);

/// Sums the products xx, xy, xz, yy, yz, zz of the same differences.
std::array<double, 6> second_moments(const float* points, size_t n,
                                     const std::array<double, 3>& about);

}  // namespace revisit
