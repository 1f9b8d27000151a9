#pragma once

#include <span>

#include "revisit/recognition/ring/descriptor.h"

namespace revisit {

inline constexpr int kRingYaws = 360;

/// Largest correlation (METHODS, eq. 6) of `a` with each of `rows[i]` over kRingYaws yaw angles.
void max_correlations(const float* a, std::span<const float* const> rows, const RingLayout& layout,
                      std::span<double> largest);

struct RingMatch {
  double similarity = 0;    // -1 .. 1
  double relative_yaw = 0;  // yaw(b) - yaw(a), counter-clockwise [rad], (-pi, pi]
};
/// Finds the maximum of the circular correlation over 360 yaw angles, then refines the yaw.
RingMatch match_rings(std::span<const float> a, std::span<const float> b, const RingLayout& layout);

}  // namespace revisit
