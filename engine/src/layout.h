#pragma once

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

}  // namespace revisit::engine
