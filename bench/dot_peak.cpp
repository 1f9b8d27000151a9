// Multiply-adds per second of one thread in float32, in bfloat16 by both its instructions, and in
// int8, as JSON; null without the instructions. docs/SPEED.md draws the conclusion.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <string>

#include "busy_loops.h"
#include "revisit/engine/machine.h"

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#endif

namespace {

using namespace revisit::profiling;

constexpr int64_t kRounds = 100000, kTileRounds = 20000;

#if defined(__x86_64__) && defined(__GNUC__)
volatile int opaque_int = 0;

__attribute__((target("avx512f,avx512bw,avx512vnni"))) LoopWork multiply_int8(int64_t rounds) {
  constexpr int kSums = 12;  // more than latency times throughput
  const __m512i factor = _mm512_set1_epi32(opaque_int);
  __m512i sums[kSums], total = factor;
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i)
    sums[i] = _mm512_set1_epi32(i);  // equal ones would be computed once
  for (int64_t round = 0; round < rounds; ++round) {
#pragma GCC unroll 12
    for (int i = 0; i < kSums; ++i) sums[i] = _mm512_dpbusd_epi32(sums[i], factor, factor);
  }
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) total += sums[i];
  return {2 * rounds * kSums * 64, static_cast<float>(_mm512_reduce_add_epi32(total))};
}

bool has_int8() {
  return __builtin_cpu_supports("avx512vnni");
}
#else
LoopWork multiply_int8(int64_t) {
  return {};
}
bool has_int8() {
  return false;
}
#endif

/// Maximum over many runs [10^9 multiply-adds/s].
std::string speed(bool has, LoopWork (*multiply)(int64_t), int64_t rounds = kRounds) {
  using Clock = std::chrono::steady_clock;
  constexpr int kRepeat = 60;
  if (!has) return "null";
  double best = std::numeric_limits<double>::infinity();
  int64_t count = 0;
  for (int repeat = 0; repeat < kRepeat; ++repeat) {
    const auto begin = Clock::now();
    const LoopWork done = multiply(rounds);
    best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
    const volatile float kept = done.result;
    static_cast<void>(kept);
    count = done.count;
  }
  return std::to_string(std::llround(1e-9 * static_cast<double>(count) / 2 / best));
}

}  // namespace

int main() {
  using namespace revisit::engine;
  std::printf("{\"gmacs\": {\"float32\": %s, \"bf16\": %s, \"bf16_tiles\": %s, \"int8\": %s}}\n",
              speed(true, multiply_float32).c_str(),
              speed(has_bf16_instructions(), multiply_bf16).c_str(),
              speed(has_bf16_tiles(), multiply_bf16_tiles, kTileRounds).c_str(),
              speed(has_int8(), multiply_int8).c_str());
}
