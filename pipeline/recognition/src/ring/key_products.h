#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "ring/spectrum.h"

namespace revisit {

/// Codes of this many places are interleaved, coefficient by coefficient.
inline constexpr int64_t kCodesPerGroup = 32;
inline constexpr int kCodeYaws = 32;
/// Real and imaginary parts of a code are in -kMaxPart .. kMaxPart, 4 bits each in a byte,
/// real part in the low bits.
inline constexpr int kMaxPart = 7;

struct CodeQuery {
  std::array<int, kRingFrequencies> counts{};  // [frequency], complex coefficients of a code
  /// Real and imaginary part of each coefficient, rounded. For each frequency, count * 2 *
  /// kMaxPart * (largest part) < 2^15, so that int16 sums cannot overflow.
  std::vector<int16_t> parts;
};

/// Computes the largest correlation of `query` with each code over kCodeYaws yaw angles, multiplied
/// by the code's scale. `keys` is [groups][coefficients][kCodesPerGroup], aligned to kCodesPerGroup
/// bytes; `scales` and `largest` are [groups * kCodesPerGroup].
void max_code_products(const CodeQuery& query, const uint8_t* keys, std::span<const float> scales,
                       std::span<float> largest);

}  // namespace revisit
