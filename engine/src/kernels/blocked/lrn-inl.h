#if defined(REVISIT_BLOCKED_LRN_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCKED_LRN_INL_H
#undef REVISIT_BLOCKED_LRN_INL_H
#else
#define REVISIT_BLOCKED_LRN_INL_H
#endif

#include <hwy/cache_control.h>
#include <hwy/contrib/math/math-inl.h>

#include <cfloat>
#include <cmath>

#include "kernels/blocked/block-inl.h"
#include "kernels/blocked/partition.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// x * scale ^ -0.75, used by all published networks.
struct ThreeQuarters {
  explicit ThreeQuarters(float) {}

  HWY_INLINE Vector operator()(Vector x, Vector scale) const {
    if constexpr (kHasReciprocalRoot14) {
      const Tag d;
      // r = scale ^ -0.25 (1 + e) with |e| < 1e-4 from two reciprocal roots of 14 bits. Then
      // q = scale * r^4 = 1 + 4e + ..., and r^3 * (1.75 - 0.75 q) has a relative error below 11
      // e^2. For 0, infinity, NaN and negative numbers q is NaN.
      const Vector inverse_root = hn::ApproximateReciprocalSqrt(scale);
      const Vector r = hn::Mul(inverse_root, hn::ApproximateReciprocalSqrt(inverse_root));
      const Vector r2 = hn::Mul(r, r);
      const Vector q = hn::Mul(hn::Mul(scale, r2), r2);
      if (HWY_LIKELY(hn::AllTrue(d, hn::Eq(q, q)))) {
        const Vector correction = hn::NegMulAdd(q, hn::Set(d, 0.75F), hn::Set(d, 1.75F));
        return hn::Mul(hn::Mul(x, hn::Mul(r, r2)), correction);
      }
    }
    const Vector root = hn::Sqrt(scale);
    return hn::Div(x, hn::Mul(root, hn::Sqrt(root)));
  }
};

/// x * scale ^ -beta.
struct AnyPower {
  float beta;
  explicit AnyPower(float b) : beta(b) {}

  HWY_INLINE Vector operator()(Vector x, Vector scale) const {
    const Tag d;
    const auto usual =
        hn::And(hn::Ge(scale, hn::Set(d, FLT_MIN)), hn::Le(scale, hn::Set(d, FLT_MAX)));
    if (HWY_LIKELY(hn::AllTrue(d, usual)))
      return hn::Mul(x, hn::Exp(d, hn::Mul(hn::Set(d, -beta), hn::Log(d, scale))));
    HWY_ALIGN float values[kVectorLanes], scales[kVectorLanes];
    hn::Store(x, d, values);
    hn::Store(scale, d, scales);
    for (int64_t i = 0; i < kVectorLanes; ++i) values[i] *= std::pow(scales[i], -beta);
    return hn::Load(d, values);
  }
};

/// All channels of some pixels; blocks of channels are `step` numbers apart.
template <class In, class Out>
struct LrnTile {
  const In* input;
  int64_t input_step;
  Out* output;
  int64_t output_step;
  int64_t pixels;
  int64_t ahead;   // offset of the data to prefetch, from the input
  float* squares;  // [pixels][pitch], zero in the margins
};

HWY_INLINE void clear_margins(const LrnSquares& s, float* squares) {
  for (int64_t i = 0; i < s.pixels; ++i) {
    std::fill_n(squares + i * s.pitch, s.margin, 0.0F);
    std::fill_n(squares + (i + 1) * s.pitch - s.margin, s.margin, 0.0F);
  }
}

/// `taps`: p.size clipped to the channels; its type may be a compile-time constant.
template <class Power, class Taps, class In, class Out>
HWY_INLINE void normalize(const LrnProblem& p, const LrnSquares& s, Taps taps,
                          const LrnTile<In, Out>& t) {
  const Tag d;
  const int64_t blocks = channel_blocks(p.c);
  for (int64_t block = 0; block < blocks; ++block)
    for (int64_t i = 0; i < t.pixels; ++i)
      for (int64_t part = 0; part < kLanes; part += kVectorLanes) {
        const auto x = load_vector(t.input + block * t.input_step + i * kLanes + part);
        hn::Store(hn::Mul(x, x), d, t.squares + i * s.pitch + s.margin + block * kLanes + part);
      }
  const Power power(p.beta);
  const auto k = hn::Set(d, p.k), factor = hn::Set(d, p.alpha / static_cast<float>(p.size));
  for (int64_t block = 0; block < blocks; ++block)
    for (int64_t i = 0; i < t.pixels; ++i)
      for (int64_t part = 0; part < kLanes; part += kVectorLanes) {
        const float* window = t.squares + i * s.pitch + s.margin + block * kLanes + part - s.half;
        auto sum = hn::LoadU(d, window);
        for (int64_t j = 1; j < taps; ++j) sum = hn::Add(sum, hn::LoadU(d, window + j));
        const In* pixel = t.input + block * t.input_step + i * kLanes + part;
        if (part == 0) hwy::Prefetch(pixel + t.ahead);
        const auto x = load_vector(pixel);
        store_vector(power(x, hn::MulAdd(factor, sum, k)),
                     t.output + block * t.output_step + i * kLanes + part);
      }
}

template <class In, class Out>
HWY_INLINE void normalize(const LrnProblem& p, const LrnSquares& s, const LrnTile<In, Out>& tile) {
  constexpr std::integral_constant<int64_t, 5> kDefault;
  const bool usual = 2 * s.half + 1 == kDefault;
  if (usual && p.beta == 0.75F)
    normalize<ThreeQuarters>(p, s, kDefault, tile);
  else if (p.beta == 0.75F)
    normalize<ThreeQuarters>(p, s, 2 * s.half + 1, tile);
  else
    normalize<AnyPower>(p, s, 2 * s.half + 1, tile);
}

}  // namespace
}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
