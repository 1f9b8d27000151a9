#include "ring/correlation.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "ring/correlation.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
constexpr D kD;

/// Vectors of 8, because a frequency has some 30 coefficients.
using Few = hn::CappedTag<float, 8>;
constexpr Few kFew;

HWY_INLINE float sum_of(hn::Vec<Few> v) {
  return hn::GetLane(hn::SumOfLanes(kFew, v));
}

/// Computes sum of a conj(b) over one frequency.
HWY_INLINE void cross(const float* a, const float* b, size_t count, bool is_complex, float& real,
                      float& imaginary) {
  const size_t lanes = hn::Lanes(kFew);
  if (count < lanes) {
    real = imaginary = 0;
    for (size_t i = 0; i < count; ++i) {
      real += a[i] * b[i] + (is_complex ? a[count + i] * b[count + i] : 0.0F);
      if (is_complex) imaginary += a[count + i] * b[i] - a[i] * b[count + i];
    }
    return;
  }
  auto re = hn::Zero(kFew), im = hn::Zero(kFew);
  for (size_t done = 0; done < count; done += lanes) {
    // The last vector overlaps the one before; overlapping elements must count once.
    const size_t i = std::min(done, count - lanes);
    const auto again = hn::FirstN(kFew, done - i);
    const auto ar = hn::IfThenZeroElse(again, hn::LoadU(kFew, a + i)), br = hn::LoadU(kFew, b + i);
    re = hn::MulAdd(ar, br, re);
    if (!is_complex) continue;
    const auto ai = hn::IfThenZeroElse(again, hn::LoadU(kFew, a + count + i)),
               bi = hn::LoadU(kFew, b + count + i);
    re = hn::MulAdd(ai, bi, re);
    im = hn::NegMulAdd(ar, bi, hn::MulAdd(ai, br, im));
  }
  real = sum_of(re);
  imaginary = is_complex ? sum_of(im) : 0.0F;
}

float largest_correlation(const float* a, const float* b, const RingLayout& layout,
                          const HalfTurn& waves) {
  float real[kRingFrequencies], imaginary[kRingFrequencies];
  for (size_t f = 0; f < kRingFrequencies; ++f) {
    const auto count = static_cast<size_t>(layout[f]);
    cross(a, b, count, f > 0, real[f], imaginary[f]);
    a += f > 0 ? 2 * count : count;
    b += f > 0 ? 2 * count : count;
  }
  V largest = hn::Set(kD, -2.0F);
  for (size_t s = 0; s < HalfTurn::kSize; s += hn::Lanes(kD)) {
    V even = hn::Zero(kD), odd = hn::Zero(kD);
    for (size_t f = 0; f < kRingFrequencies; ++f) {
      even = hn::MulAdd(hn::Set(kD, real[f]), hn::Load(kD, waves.cosines[f].data() + s), even);
      odd = hn::MulAdd(hn::Set(kD, imaginary[f]), hn::Load(kD, waves.sines[f].data() + s), odd);
    }
    largest = hn::Max(largest, hn::Add(even, hn::Abs(odd)));
  }
  return hn::GetLane(hn::MaxOfLanes(kD, largest));
}

void largest_correlations_simd(const float* a, std::span<const float* const> rows,
                               const RingLayout& layout, std::span<double> largest,
                               const HalfTurn& waves) {
  for (size_t i = 0; i < rows.size(); ++i)
    largest[i] = static_cast<double>(largest_correlation(a, rows[i], layout, waves));
}

}  // namespace
}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(largest_correlations_simd);

void max_correlations(const float* a, std::span<const float* const> rows, const RingLayout& layout,
                      std::span<double> largest) {
  static const HalfTurn waves;
  HWY_DYNAMIC_DISPATCH(largest_correlations_simd)(a, rows, layout, largest, waves);
}

}  // namespace revisit
#endif  // HWY_ONCE
