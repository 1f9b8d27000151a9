// Whether narrower numbers could pay: multiply-adds a second of one thread in float32, bf16 and
// int8 with the AVX-512 instructions made for each, as JSON. docs/SPEED.md draws the
// conclusion.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <limits>

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>

namespace {

constexpr int64_t kRounds = 200000;
constexpr int kSums = 12;  // more than latency times throughput
#define REVISIT_DOT_TARGET __attribute__((target("avx512f,avx512bw,avx512vnni,avx512bf16")))

volatile float opaque_float = 0;
volatile int opaque_int = 0;

/// `kRounds` times `kSums` of `add(sum, factor)`.
template <class Vector, class Add>
REVISIT_DOT_TARGET inline __attribute__((always_inline)) void sum_up(Vector start, const Add& add,
                                                                     Vector* total) {
  Vector sums[kSums];
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i)  // equal ones would be computed once
    sums[i] = start + static_cast<decltype(start[0] + 0)>(i);
  for (int64_t round = 0; round < kRounds; ++round) {
#pragma GCC unroll 12
    for (int i = 0; i < kSums; ++i) sums[i] = add(sums[i]);
  }
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) *total += sums[i];
}

REVISIT_DOT_TARGET void add_float32() {
  const __m512 factor = _mm512_set1_ps(opaque_float);
  __m512 total = factor;
  sum_up(
      factor, [=](__m512 sum) REVISIT_DOT_TARGET { return _mm512_fmadd_ps(factor, factor, sum); },
      &total);
  opaque_float = _mm512_cvtss_f32(total);
}

REVISIT_DOT_TARGET void add_bf16() {
  const __m512 zero = _mm512_set1_ps(opaque_float);
  const auto factor = reinterpret_cast<__m512bh>(zero);
  __m512 total = zero;
  sum_up(
      zero, [=](__m512 sum) REVISIT_DOT_TARGET { return _mm512_dpbf16_ps(sum, factor, factor); },
      &total);
  opaque_float = _mm512_cvtss_f32(total);
}

REVISIT_DOT_TARGET void add_int8() {
  const __m512i factor = _mm512_set1_epi32(opaque_int);
  __m512i total = factor;
  sum_up(
      factor,
      [=](__m512i sum) REVISIT_DOT_TARGET { return _mm512_dpbusd_epi32(sum, factor, factor); },
      &total);
  opaque_int = _mm512_cvtsi512_si32(total);
}

/// Billions of multiply-adds a second, the best of many runs.
double speed(void (*run)(), int64_t per_instruction) {
  using Clock = std::chrono::steady_clock;
  constexpr int kRepeat = 60;
  double best = std::numeric_limits<double>::infinity();
  for (int repeat = 0; repeat < kRepeat; ++repeat) {
    const auto begin = Clock::now();
    run();
    best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count());
  }
  return 1e-9 * static_cast<double>(kRounds * kSums * per_instruction) / best;
}

}  // namespace

int main() {
  if (!__builtin_cpu_supports("avx512bf16") || !__builtin_cpu_supports("avx512vnni")) {
    std::fprintf(stderr, "this CPU has no AVX512_BF16 and AVX512_VNNI: nothing to measure\n");
    return 1;
  }
  std::printf("{\"gmacs\": {\"float32\": %.0f, \"bf16\": %.0f, \"int8\": %.0f}}\n",
              speed(add_float32, 16), speed(add_bf16, 32), speed(add_int8, 64));
}
#else
int main() {
  std::fprintf(stderr, "only for x86-64\n");
  return 1;
}
#endif
