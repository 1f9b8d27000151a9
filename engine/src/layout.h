#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Size of memory in bytes, because only kernels know the type of the numbers.
struct Bytes {
  int64_t count = 0;
  constexpr Bytes() = default;
  explicit constexpr Bytes(int64_t n) : count(n) {}
};
constexpr Bytes floats(int64_t n) {
  return Bytes(n * static_cast<int64_t>(sizeof(float)));
}

/// Size of a number in an NCHWc value [bytes].
constexpr int64_t value_bytes(Precision values) {
  return values == Precision::kBf16 ? 2 : 4;
}

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

enum class Layout {
  kNchw,     // NCHW: [n][c][h][w], float32
  kNChw16c,  // NCHWc: [n][ceil(c / kLanes)][h][w][kLanes], in the plan's Precision; lanes beyond c
             // are zero, blocks are aligned to their size
};

/// Channels per block on every CPU: one register with AVX-512, two with AVX2, four with NEON.
constexpr int64_t kLanes = 16;

constexpr int64_t channel_blocks(int64_t c) {
  return (c + kLanes - 1) / kLanes;
}
constexpr int64_t padded_channels(int64_t c) {
  return channel_blocks(c) * kLanes;
}
constexpr bool fills_blocks(int64_t c) {
  constexpr int64_t kMaxWaste = 2;
  return padded_channels(c) <= kMaxWaste * c;
}

/// Splits `items` into `parts` parts equal to within one `unit`; all but the last have full units.
struct Split {
  int64_t items, parts, unit = 1;

  int64_t units() const { return (items + unit - 1) / unit; }
  int64_t begin(int64_t part) const { return std::min(units() * part / parts * unit, items); }
  int64_t end(int64_t part) const { return begin(part + 1); }
  int64_t width(int64_t part) const { return end(part) - begin(part); }
  int64_t widest() const { return (units() + parts - 1) / parts * unit; }
};

}  // namespace revisit::engine
