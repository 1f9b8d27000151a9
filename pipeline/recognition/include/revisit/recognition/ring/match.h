#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "revisit/recognition/comparison.h"

namespace revisit {

/// Layout of a descriptor: frequency by frequency, first the real parts, then (except for frequency
/// 0) the imaginary parts.
struct RingLayout {
  std::vector<int> counts;  // [frequency], number of complex coefficients
  int64_t numbers() const;
};

struct RingMatch {
  double similarity = 0;    // -1 .. 1
  double relative_yaw = 0;  // yaw(b) - yaw(a), counter-clockwise [rad], (-pi, pi]
};
/// Finds the maximum of the circular correlation over 360 yaw angles, then refines the yaw.
RingMatch match_rings(std::span<const float> a, std::span<const float> b, const RingLayout& layout);

/// Compares a query with many places by match_rings(); the similarity is 0 for a zero descriptor.
/// Candidates may be preselected by compact codes: 128 complex coefficients of a descriptor, one
/// byte each, compared at 32 yaw angles. Throws UsageError for more frequencies than rings have.
Comparison ring_comparison(const RingLayout& layout, int64_t code_candidates = 0);

}  // namespace revisit
