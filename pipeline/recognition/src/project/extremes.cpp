#include "project/extremes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "project/extremes.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Floats = hn::ScalableTag<float>;
constexpr Floats kFloats;

/// out[i] = extreme(in[i], in[i + ahead]). `out` may be `in`: elements are not read after a write.
template <class Extreme>
HWY_INLINE void pair_up(const float* in, int64_t ahead, int64_t n, Extreme extreme, float* out) {
  const int64_t lanes = static_cast<int64_t>(hn::Lanes(kFloats));
  int64_t i = 0;
  for (; i + lanes <= n; i += lanes)
    hn::StoreU(extreme(hn::LoadU(kFloats, in + i), hn::LoadU(kFloats, in + i + ahead)), kFloats,
               out + i);
  const hn::CappedTag<float, 1> one;
  for (; i < n; ++i)
    hn::StoreU(extreme(hn::LoadU(one, in + i), hn::LoadU(one, in + i + ahead)), one, out + i);
}

/// Combines two overlapping windows of the largest power of two, computed by doubling.
template <class Extreme>
void slide(float* in, int64_t n, int64_t step, int64_t window, Extreme extreme, float* out) {
  int64_t covered = 1;
  for (; 2 * covered < window; covered *= 2)
    pair_up(in, covered * step, (n + window - 2 * covered) * step, extreme, in);
  pair_up(in, (window - covered) * step, n * step, extreme, out);
}

}  // namespace

void sliding_extreme_simd(float* in, int64_t n, int64_t step, int64_t window, Extreme extreme,
                          float* out) {
  if (extreme == Extreme::kMax)
    slide(
        in, n, step, window, [](auto a, auto b) HWY_ATTR { return hn::Max(a, b); }, out);
  else
    slide(
        in, n, step, window, [](auto a, auto b) HWY_ATTR { return hn::Min(a, b); }, out);
}

}  // namespace revisit::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit {

HWY_EXPORT(sliding_extreme_simd);

void sliding_extreme(float* in, int64_t n, int64_t step, int64_t window, Extreme extreme,
                     float* out) {
  HWY_DYNAMIC_DISPATCH(sliding_extreme_simd)(in, n, step, window, extreme, out);
}

}  // namespace revisit
#endif  // HWY_ONCE
