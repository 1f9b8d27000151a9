#pragma once

#include <cstdint>

#include "revisit/engine/precision.h"

namespace revisit::engine {

/// Memory. Planning counts in bytes: only the kernel that makes the numbers knows their type.
struct Bytes {
  int64_t count = 0;
  constexpr Bytes() = default;
  explicit constexpr Bytes(int64_t n) : count(n) {}
};
constexpr Bytes floats(int64_t n) {
  return Bytes(n * static_cast<int64_t>(sizeof(float)));
}

/// Of a number of a blocked value.
constexpr int64_t value_bytes(Precision values) {
  return values == Precision::kBf16 ? 2 : 4;
}

/// How the numbers of a value `[n][c][h][w]` lie in memory.
enum class Layout {
  kNchw,     // [n][c][h][w]: "plain"
  kNChw16c,  // "blocked": [n][ceil(c / kLanes)][h][w][kLanes], lanes beyond c are zero, blocks
             // aligned to their size; of the plan's Precision, while plain ones are float32
};

/// Channels of a block, on every CPU: one AVX-512 register, two of AVX2, four of NEON.
constexpr int64_t kLanes = 16;

constexpr int64_t channel_blocks(int64_t c) {
  return (c + kLanes - 1) / kLanes;
}
constexpr int64_t padded_channels(int64_t c) {
  return channel_blocks(c) * kLanes;
}
/// Whether lanes are not mostly padding, which would take many times the memory of plain values.
constexpr bool fills_blocks(int64_t c) {
  constexpr int64_t kMostWaste = 2;
  return padded_channels(c) <= kMostWaste * c;
}

}  // namespace revisit::engine
