#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "ring/spectrum.h"

namespace revisit::pipeline {

/// Keys of so many places lie together, number by number.
inline constexpr int64_t kKeysTogether = 32;
/// Keys are compared at so many turns.
inline constexpr int kKeyTurns = 32;
/// Real and imaginary parts of a key are -kLargestPart .. kLargestPart: a byte, real part below.
inline constexpr int kLargestPart = 7;

/// What keys are compared with.
struct KeyQuery {
  std::array<int, kRingFrequencies> counts{};  // of each frequency: complex numbers of a key
  /// Real and imaginary part of each, rounded. Of a frequency count * 2 * kLargestPart * the
  /// largest is less than 2^15.
  std::vector<int16_t> parts;
};

/// The largest correlation of `query` over kKeyTurns turns with each of the keys
/// [groups][numbers][kKeysTogether], times their `scales` -> `largest`, both [groups *
/// kKeysTogether]. `keys` is aligned to kKeysTogether bytes.
void largest_key_products(const KeyQuery& query, const uint8_t* keys, std::span<const float> scales,
                          std::span<float> largest);

}  // namespace revisit::pipeline
