#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "layout.h"

namespace revisit::test {

/// Fill bytes of outputs and scratch; kNanByte makes floats NaN.
constexpr unsigned char kNanByte = 0xFF, kDirtyByte = 0xA5;

/// Buffer with 64-byte alignment, as in the engine.
class AlignedFloats {
 public:
  AlignedFloats(int64_t count, unsigned char byte);
  AlignedFloats(AlignedFloats&&) noexcept;
  ~AlignedFloats();

  float* data() { return data_; }
  const float* data() const { return data_; }
  std::span<const float> values() const { return {data_, size_}; }

 private:
  float* data_;
  size_t size_;
};

/// Converts between `[n][c][pixels]` and Layout::kNChw16c, by definition.
AlignedFloats to_blocked(int64_t n, int64_t c, int64_t pixels, std::span<const float> plain);
std::vector<float> to_plain(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked);

/// Two bfloat16 take the space of a float.
AlignedFloats rounded_to_bf16(const AlignedFloats& blocked);
AlignedFloats widened(const AlignedFloats& bf16);

/// Returns the index of the first nonzero lane beyond `c`, or -1.
int64_t find_dirty_tail(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked);

}  // namespace revisit::test
