#pragma once

#include <cstdint>

namespace revisit::profiling {

// Loops that do nothing but one thing, as fast as one thread can. Each returns what depends on all
// of its work, so that the compiler leaves nothing out.

/// Independent sums: more than latency times throughput of any CPU's multiply-add.
constexpr int kSums = 12;

/// Floating-point operations that a loop did.
struct LoopWork {
  int64_t count = 0;
  float result = 0;
};
/// Multiplies and adds float32 in registers.
LoopWork multiply_float32(int64_t rounds);
/// The same of bfloat16, by AVX512-BF16 or by AMX tiles: for CPUs that have them (simd.h).
LoopWork multiply_bf16(int64_t rounds);
LoopWork multiply_bf16_tiles(int64_t rounds);

/// `count` numbers, a multiple of kLoopFloats, from addresses of whole cache lines.
constexpr int64_t kLoopFloats = 64;
float read_floats(const float* from, int64_t count);
void copy_floats(const float* from, float* to, int64_t count);

}  // namespace revisit::profiling
