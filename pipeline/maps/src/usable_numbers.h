#pragma once

#include <algorithm>
#include <cmath>
#include <span>

namespace revisit::pipeline {

/// What is learnt and compared is made of sums of products of a few such numbers, which floats
/// hold.
inline constexpr float kLargest = 1e9F;
inline constexpr const char* kTooLarge = "numbers that are not finite, or above 1e9";
inline bool can_be_used(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float v) { return std::abs(v) <= kLargest; });
}

}  // namespace revisit::pipeline
