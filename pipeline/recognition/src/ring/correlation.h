#pragma once

#include <span>

#include "revisit/recognition/ring/descriptor.h"

namespace revisit {

inline constexpr int kRingYaws = 360;

/// Largest correlation of `a` with each of `rows[i]` over kRingYaws yaw angles.
void max_correlations(const float* a, std::span<const float* const> rows, const RingLayout& layout,
                      std::span<double> largest);

}  // namespace revisit
