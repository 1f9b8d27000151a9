#pragma once

#include <algorithm>
#include <cmath>
#include <span>

namespace revisit {

/// Limit of magnitudes, so that sums of products of a few values do not overflow floats.
inline constexpr float kLargest = 1e9F;
inline constexpr const char* kTooLarge = "numbers that are not finite, or above 1e9";
inline bool is_usable(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float v) { return std::abs(v) <= kLargest; });
}

}  // namespace revisit
