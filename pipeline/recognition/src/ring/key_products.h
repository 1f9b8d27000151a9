#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "ring/spectrum.h"

namespace revisit::pipeline {

/// Codes of this many places are interleaved, coefficient by coefficient.
inline constexpr int64_t kKeysTogether = 32;
/// Number of yaw angles at which codes are compared.
inline constexpr int kKeyTurns = 32;
/// Real and imaginary parts of a code are in -kLargestPart .. kLargestPart, 4 bits each in a byte,
/// real part in the low bits.
inline constexpr int kLargestPart = 7;

struct KeyQuery {
  std::array<int, kRingFrequencies> counts{};  // [frequency], complex coefficients of a code
  /// Real and imaginary part of each coefficient, rounded. For each frequency, count * 2 *
  /// kLargestPart * (largest part) < 2^15, so that int16 sums cannot overflow.
  std::vector<int16_t> parts;
};

/// Computes the largest correlation of `query` with each code over kKeyTurns yaw angles, multiplied
/// by the code's scale. `keys` is [groups][coefficients][kKeysTogether], aligned to kKeysTogether
/// bytes; `scales` and `largest` are [groups * kKeysTogether].
void largest_key_products(const KeyQuery& query, const uint8_t* keys, std::span<const float> scales,
                          std::span<float> largest);

}  // namespace revisit::pipeline
