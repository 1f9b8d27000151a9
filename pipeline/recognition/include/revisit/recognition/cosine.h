#pragma once

#include <span>

namespace revisit {

/// Euclidean norm, computed in double. Equal input gives equal bits.
double length_of(std::span<const float> x);

/// Computed in double; 0 for a zero row. Equal input gives equal bits.
double cosine(std::span<const float> a, double length_a, std::span<const float> b, double length_b);

}  // namespace revisit
