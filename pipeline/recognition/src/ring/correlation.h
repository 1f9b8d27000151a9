#pragma once

#include <span>

#include "revisit/recognition/ring/match.h"

namespace revisit::pipeline {

/// Number of yaw angles tried.
inline constexpr int kRingYaws = 360;

/// Computes the largest correlation of a descriptor with each of `rows[i]`, over kRingYaws yaw
/// angles.
void max_correlations(const float* a, std::span<const float* const> rows, const RingLayout& layout,
                      std::span<double> largest);

}  // namespace revisit::pipeline
