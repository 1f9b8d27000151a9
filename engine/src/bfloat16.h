#pragma once

#include <bit>
#include <cstdint>

namespace revisit::engine {

/// The upper half of a float32.
struct BFloat16 {
  uint16_t bits;
};

inline float to_float(BFloat16 x) {
  return std::bit_cast<float>(uint32_t{x.bits} << 16);
}

/// Rounds to nearest even; NaN stays NaN.
inline BFloat16 to_bfloat16(float x) {
  const auto bits = std::bit_cast<uint32_t>(x);
  constexpr uint32_t kQuiet = 1 << 22, kHalf = 0x7FFF;
  const uint32_t rounded = x != x ? bits | kQuiet : bits + kHalf + (bits >> 16 & 1);
  return {static_cast<uint16_t>(rounded >> 16)};
}

}  // namespace revisit::engine
