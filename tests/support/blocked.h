#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "bfloat16.h"
#include "layout.h"

/// Blocked values for tests of kernels.
namespace revisit::test {

/// Bytes that outputs and scratch memory are filled with: the first makes floats NaN.
constexpr unsigned char kNanByte = 0xFF, kDirtyByte = 0xA5;

/// A buffer as the engine's: 64-byte aligned.
class AlignedFloats {
 public:
  /// Every byte is `byte`.
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

/// `[n][c][pixels]` in Layout::kNChw16c, and back; both written from the definition.
AlignedFloats to_blocked(int64_t n, int64_t c, int64_t pixels, std::span<const float> plain);
std::vector<float> to_plain(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked);

/// Each number as a BFloat16, two in the room of a float; and back.
AlignedFloats rounded_to_bf16(const AlignedFloats& blocked);
AlignedFloats widened(const AlignedFloats& bf16);

/// The first lane beyond `c` that is not zero, or -1.
int64_t find_dirty_tail(int64_t n, int64_t c, int64_t pixels, std::span<const float> blocked);

}  // namespace revisit::test
