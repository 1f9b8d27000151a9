#pragma once

#include <span>

#include "revisit/recognition/ring/match.h"

namespace revisit::pipeline {

/// So many turns are tried.
inline constexpr int kRingTurns = 360;

/// The largest correlation of one descriptor with each of `rows[i]`, over kRingTurns turns.
void largest_correlations(const float* a, std::span<const float* const> rows,
                          const RingLayout& layout, std::span<double> largest);

}  // namespace revisit::pipeline
