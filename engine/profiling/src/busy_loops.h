#pragma once

#include <cstdint>

namespace revisit::profiling {

// Single-thread loops that saturate one resource. Each returns a value that depends on all of its
// work, so that the compiler cannot remove any.

/// Independent sums, more than latency times throughput of the multiply-add of any CPU.
constexpr int kSums = 12;

struct LoopWork {
  int64_t count = 0;
  float result = 0;
};
LoopWork multiply_float32(int64_t rounds);
/// Require AVX512-BF16 and AMX tiles, respectively (simd.h).
LoopWork multiply_bf16(int64_t rounds);
LoopWork multiply_bf16_tiles(int64_t rounds);

/// `count` must be a multiple of kLoopFloats, and addresses aligned to cache lines.
constexpr int64_t kLoopFloats = 64;
float read_floats(const float* from, int64_t count);
void copy_floats(const float* from, float* to, int64_t count);

}  // namespace revisit::profiling
