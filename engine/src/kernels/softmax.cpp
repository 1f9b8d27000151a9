#include <algorithm>
#include <cmath>

#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/softmax.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Wide = hn::ScalableTag<float>;
using Numbers = hn::Vec<Wide>;

/// e^x for x <= 0; preserves NaN.
HWY_INLINE Numbers exp_of(Numbers x) {
  return hn::IfThenElse(hn::Eq(x, x), hn::Exp(Wide(), x), x);
}

/// Normalizes the first `count` lanes of adjacent lines, with `classes` values `step` apart.
void normalize(const float* in, int64_t classes, int64_t step, size_t count, float* out) {
  const Wide d;
  // MaskedLoad and BlendedStore are unsuitable: SSE4 and NEON read full vectors, and NEON writes
  // back lanes that belong to another thread.
  float padded[hn::MaxLanes(d)] = {};
  const auto load = [&](const float* from) HWY_ATTR {
    if (count == hn::Lanes(d)) return hn::LoadU(d, from);
    std::copy_n(from, count, padded);
    return hn::LoadU(d, padded);
  };
  const auto store = [&](Numbers x, float* to) HWY_ATTR {
    if (count == hn::Lanes(d)) return hn::StoreU(x, d, to);
    hn::StoreU(x, d, padded);
    std::copy_n(padded, count, to);
  };
  Numbers largest = load(in);
  for (int64_t c = 1; c < classes; ++c) {
    const Numbers x = load(in + c * step);
    largest = hn::IfThenElse(hn::Lt(largest, x), x, largest);
  }
  // Partial sums, because thousands of terms near 1 would round in the same direction.
  constexpr int64_t kPart = 128;
  Numbers sum = hn::Zero(d);
  for (int64_t first = 0; first < classes; first += kPart) {
    Numbers part = hn::Zero(d);
    for (int64_t c = first; c < std::min(first + kPart, classes); ++c) {
      const Numbers e = exp_of(hn::Sub(load(in + c * step), largest));
      store(e, out + c * step);
      part = hn::Add(part, e);
    }
    sum = hn::Add(sum, part);
  }
  for (int64_t c = 0; c < classes; ++c) store(hn::Div(load(out + c * step), sum), out + c * step);
}

}  // namespace

void softmax_lines(const float* in, const AxisRuns& lines, float* out, int threads) {
  const auto lanes = static_cast<int64_t>(hn::Lanes(Wide()));
  const int64_t size = lines.size * lines.inner;
  const int64_t vectors =
      std::max<int64_t>(kParallelGrain / std::max<int64_t>(lines.size, 1) / lanes, 1);
  const int64_t width = vectors * lanes, pieces = (lines.inner + width - 1) / width;
  parallel_for(lines.outer * pieces, threads, [&](int64_t item, int) HWY_ATTR {
    const int64_t begin = item % pieces * width, end = std::min(begin + width, lines.inner);
    const int64_t at = item / pieces * size;
    for (int64_t i = begin; i < end; i += lanes)
      normalize(in + at + i, lines.size, lines.inner, static_cast<size_t>(std::min(lanes, end - i)),
                out + at + i);
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(softmax_lines);

namespace {

void normalize_line(const float* in, int64_t classes, int64_t step, float* out) {
  float largest = in[0];
  for (int64_t c = 1; c < classes; ++c) largest = std::max(largest, in[c * step]);
  double sum = 0;  // in float, thousands of terms near 1 would round in the same direction
  for (int64_t c = 0; c < classes; ++c) sum += out[c * step] = std::exp(in[c * step] - largest);
  for (int64_t c = 0; c < classes; ++c) out[c * step] /= static_cast<float>(sum);
}

}  // namespace

void softmax(const float* in, const AxisRuns& lines, float* out, int threads) {
  constexpr int64_t kFewLines = 4;
  if (lines.size == 0) return;
  if (lines.inner >= kFewLines) return HWY_DYNAMIC_DISPATCH(softmax_lines)(in, lines, out, threads);
  for (int64_t line = 0; line < lines.outer * lines.inner; ++line) {
    const int64_t first = line / lines.inner * lines.size * lines.inner + line % lines.inner;
    normalize_line(in + first, lines.size, lines.inner, out + first);
  }
}

void softmax_reference(const float* in, const AxisRuns& lines, float* out) {
  for (int64_t line = 0; line < lines.outer * lines.inner; ++line) {
    const int64_t first = line / lines.inner * lines.size * lines.inner + line % lines.inner;
    const int64_t end = first + lines.size * lines.inner;
    float largest = -INFINITY;
    for (int64_t i = first; i < end; i += lines.inner) largest = std::max(largest, in[i]);
    // The difference is computed in float, as in Caffe.
    const auto power = [&](int64_t i) { return std::exp(static_cast<double>(in[i] - largest)); };
    double sum = 0;
    for (int64_t i = first; i < end; i += lines.inner) sum += power(i);
    for (int64_t i = first; i < end; i += lines.inner) out[i] = static_cast<float>(power(i) / sum);
  }
}

}  // namespace revisit::engine
#endif
