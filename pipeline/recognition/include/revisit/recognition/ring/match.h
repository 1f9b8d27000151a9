#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "revisit/recognition/comparison.h"

namespace revisit::pipeline {

/// How the numbers of a ring descriptor are arranged: frequency after frequency, of each first the
/// real parts, then, but for frequency 0, the imaginary parts.
struct RingLayout {
  std::vector<int> counts;  // of each frequency: complex numbers
  int64_t numbers() const;
};

/// How alike two descriptors are, at the heading where they are most alike.
struct RingMatch {
  double similarity = 0;  // -1 .. 1
  double turn = 0;        // heading of b less heading of a, counter-clockwise [rad], (-pi, pi]
};
/// The largest circular correlation over all turns (360 of them; `turn` is then refined).
RingMatch match_rings(std::span<const float> a, std::span<const float> b, const RingLayout& layout);

/// The same of a query with many: similarity (0 for a descriptor that is all zero) and turn. A key
/// is a rough copy of a descriptor, 128 of its complex numbers in a byte each, compared at 32
/// turns. Throws UsageError for more frequencies than rings have.
Comparison ring_comparison(const RingLayout& layout, int64_t key_candidates = 0);

}  // namespace revisit::pipeline
