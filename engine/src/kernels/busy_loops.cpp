#include "kernels/busy_loops.h"

#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/busy_loops.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;

/// Independent sums: more than latency times throughput of any CPU's multiply-add.
constexpr int kSums = 12;

LoopWork multiply_float32_here(int64_t rounds) {
  const Floats d;
  // Seen by the compiler they would be computed before; nothing grows or fades.
  volatile float one = 1, small = 1e-7F;
  const auto factor = hn::Set(d, one), addend = hn::Set(d, small);
  hn::Vec<Floats> sums[kSums];
#pragma GCC unroll 12
  for (int i = 0; i < kSums; ++i) sums[i] = hn::Set(d, static_cast<float>(i));  // not equal
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
}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

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

}  // namespace revisit::engine
#endif
