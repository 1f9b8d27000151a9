#include "busy_loops.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "busy_loops.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

#if HWY_ARCH_X86_64
#include <immintrin.h>
#endif

HWY_BEFORE_NAMESPACE();
namespace revisit::profiling::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;

LoopWork multiply_float32_here(int64_t rounds) {
  const Floats d;
  // volatile prevents evaluation at compile time; the values keep the sums bounded.
  volatile float one = 1, small = 1e-7F;
  const auto factor = hn::Set(d, one), addend = hn::Set(d, small);
  hn::Vec<Floats> sums[kSums];
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) sums[i] = hn::Set(d, static_cast<float>(i));
  for (int64_t round = 0; round < rounds; ++round) {
#pragma GCC unroll 12
    for (int i = 0; i < kSums; ++i) sums[i] = hn::MulAdd(sums[i], factor, addend);
  }
  auto all = hn::Zero(d);
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) all = hn::Add(all, sums[i]);
  return {2 * rounds * kSums * static_cast<int64_t>(hn::Lanes(d)),
          hn::GetLane(hn::SumOfLanes(d, all))};
}

float read_here(const float* from, int64_t count) {
  const Floats d;
  const auto lanes = static_cast<int64_t>(hn::Lanes(d));
  auto a = hn::Zero(d), b = a, c = a, e = a;
  for (int64_t i = 0; i < count; i += 4 * lanes) {
    a = hn::Add(a, hn::Load(d, from + i));
    b = hn::Add(b, hn::Load(d, from + i + lanes));
    c = hn::Add(c, hn::Load(d, from + i + 2 * lanes));
    e = hn::Add(e, hn::Load(d, from + i + 3 * lanes));
  }
  return hn::GetLane(hn::SumOfLanes(d, hn::Add(hn::Add(a, b), hn::Add(c, e))));
}

void copy_here(const float* from, float* to, int64_t count) {
  const Floats d;
  const auto lanes = static_cast<int64_t>(hn::Lanes(d));
  for (int64_t i = 0; i < count; i += 4 * lanes) {
    const auto a = hn::Load(d, from + i), b = hn::Load(d, from + i + lanes),
               c = hn::Load(d, from + i + 2 * lanes), e = hn::Load(d, from + i + 3 * lanes);
    hn::Store(a, d, to + i);
    hn::Store(b, d, to + i + lanes);
    hn::Store(c, d, to + i + 2 * lanes);
    hn::Store(e, d, to + i + 3 * lanes);
  }
}

}  // namespace
}  // namespace revisit::profiling::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::profiling {
#if HWY_ARCH_X86_64
namespace {

/// Configures eight tiles (16 rows of 64 bytes) of the calling thread for its lifetime.
class Tiles {
 public:
  Tiles() {
    struct alignas(64) Configuration {
      uint8_t palette = 1, start_row = 0, reserved[14] = {};
      uint16_t row_bytes[16] = {64, 64, 64, 64, 64, 64, 64, 64};
      uint8_t rows[16] = {16, 16, 16, 16, 16, 16, 16, 16};
    };
    const Configuration whole;
    asm volatile("ldtilecfg %0" ::"m"(whole));
  }
  ~Tiles() { asm volatile("tilerelease"); }
  Tiles(const Tiles&) = delete;
  Tiles& operator=(const Tiles&) = delete;
};

}  // namespace

__attribute__((target("avx512f,avx512bf16"))) LoopWork multiply_bf16(int64_t rounds) {
  volatile float one = 1;
  const __m512 ones = _mm512_set1_ps(one);
  const __m512bh factor = _mm512_cvtne2ps_pbh(ones, ones);
  __m512 sums[kSums];
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) sums[i] = _mm512_set1_ps(static_cast<float>(i));
  for (int64_t round = 0; round < rounds; ++round) {
#pragma GCC unroll 12
    for (int i = 0; i < kSums; ++i) sums[i] = _mm512_dpbf16_ps(sums[i], factor, factor);
  }
#pragma GCC unroll 12
  for (int i = 1; i < kSums; ++i) sums[0] = _mm512_add_ps(sums[0], sums[i]);
  return {2 * rounds * kSums * 32, _mm512_cvtss_f32(sums[0])};
}

LoopWork multiply_bf16_tiles(int64_t rounds) {
  constexpr int64_t kRows = 16, kRowBytes = 64, kDepth = 32;
  alignas(64) const uint16_t numbers[kRows * kDepth] = {};
  alignas(64) float sums[kRows * kRows];
  const Tiles tiles;
  asm volatile(
      "tilezero %%tmm0\n tilezero %%tmm1\n tilezero %%tmm2\n tilezero %%tmm3\n"
      "tileloadd (%0,%1), %%tmm4\n tileloadd (%0,%1), %%tmm5\n"
      "tileloadd (%0,%1), %%tmm6\n tileloadd (%0,%1), %%tmm7" ::"r"(&numbers[0]),
      "r"(kRowBytes)
      : "memory");
  for (int64_t round = 0; round < rounds; ++round)
    asm volatile(
        "tdpbf16ps %tmm6, %tmm4, %tmm0\n tdpbf16ps %tmm7, %tmm4, %tmm1\n"
        "tdpbf16ps %tmm6, %tmm5, %tmm2\n tdpbf16ps %tmm7, %tmm5, %tmm3");
  asm volatile("tilestored %%tmm3, (%0,%1)" ::"r"(&sums[0]), "r"(kRowBytes) : "memory");
  return {2 * rounds * 4 * kRows * kRows * kDepth, sums[0]};
}
#else
LoopWork multiply_bf16(int64_t) {
  return {};
}

LoopWork multiply_bf16_tiles(int64_t) {
  return {};
}
#endif

HWY_EXPORT(multiply_float32_here);
HWY_EXPORT(read_here);
HWY_EXPORT(copy_here);

LoopWork multiply_float32(int64_t rounds) {
  return HWY_DYNAMIC_DISPATCH(multiply_float32_here)(rounds);
}

float read_floats(const float* from, int64_t count) {
  return HWY_DYNAMIC_DISPATCH(read_here)(from, count);
}

void copy_floats(const float* from, float* to, int64_t count) {
  HWY_DYNAMIC_DISPATCH(copy_here)(from, to, count);
}

}  // namespace revisit::profiling
#endif
