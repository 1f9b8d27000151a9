#include <algorithm>

#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/strided_copy.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/transpose-inl.h"

#if HWY_ONCE

namespace revisit::engine {

HWY_EXPORT(transpose);

namespace {

void copy_rows(const StridedCopyProblem& p, const float* input, float* output) {
  const size_t last = p.shape.size() - 1;
  const int64_t width = p.shape[last], stride = p.strides[last];
  const int64_t height = last > 0 ? p.shape[last - 1] : 1;
  const int64_t step = last > 0 ? p.strides[last - 1] : 0;
  int64_t rows = 1;
  for (size_t axis = 0; axis < last; ++axis) rows *= p.shape[axis];
  const int64_t grain = std::max<int64_t>(kParallelGrain / width, 1);
  parallel_ranges(rows, grain, p.threads, [&](int64_t begin, int64_t end) {
    float* out = output + begin * width;
    for (int64_t row = begin; row < end;) {
      const float* in = input + p.offset + row % height * step;
      for (int64_t axis = static_cast<int64_t>(last) - 2, rest = row / height; axis >= 0; --axis) {
        in += rest % p.shape[axis] * p.strides[axis];
        rest /= p.shape[axis];
      }
      const int64_t stop = std::min(end, row - row % height + height);
      for (; row < stop; ++row, in += step, out += width) {
        if (stride == 1)
          std::copy_n(in, width, out);
        else if (stride == -1)
          std::reverse_copy(in - width + 1, in + 1, out);
        else
          for (int64_t i = 0; i < width; ++i) out[i] = in[i * stride];
      }
    }
  });
}

/// Side of the squares in copy_squares(): one row is a cache line.
constexpr int64_t kSide = 16;

/// Minimum rows and columns for which squares are faster than rows.
constexpr int64_t kMinSquares = 4;

/// Requires an axis `unit` of the output, not the last, that is contiguous in the input. Transposes
/// squares of the two axes, so that a cache line read for one row serves the next.
void copy_squares(const StridedCopyProblem& p, size_t unit, const float* input, float* output) {
  const size_t last = p.shape.size() - 1;
  const int64_t width = p.shape[last], height = p.shape[unit];
  int64_t step = 1, planes = 1;
  for (size_t axis = 0; axis < last; ++axis) {
    if (axis != unit) planes *= p.shape[axis];
    if (axis >= unit) step *= p.shape[axis + 1];
  }
  const int64_t strips = (height + kSide - 1) / kSide;
  const int64_t grain = std::max<int64_t>(kParallelGrain / (width * kSide), 1);
  auto& transpose_matrix = HWY_DYNAMIC_DISPATCH(transpose);
  parallel_ranges(planes * strips, grain, p.threads, [&](int64_t begin, int64_t end) {
    for (int64_t strip = begin; strip < end; ++strip) {
      const int64_t first = strip % strips * kSide;
      const float* in = input + p.offset + first;
      float* out = output + first * step;
      int64_t rest = strip / strips, out_stride = width;
      for (int64_t axis = static_cast<int64_t>(last) - 1; axis >= 0; --axis) {
        if (axis != static_cast<int64_t>(unit)) {
          in += rest % p.shape[axis] * p.strides[axis];
          out += rest % p.shape[axis] * out_stride;
          rest /= p.shape[axis];
        }
        out_stride *= p.shape[axis];
      }
      for (int64_t column = 0; column < width; column += kSide)
        transpose_matrix(std::min(kSide, width - column), std::min(kSide, height - first),
                         in + column * p.strides[last], p.strides[last], out + column, step);
    }
  });
}

}  // namespace

void strided_copy(const StridedCopyProblem& p, const float* input, float* output) {
  const size_t last = p.shape.size() - 1;
  for (size_t axis = 0; axis < last; ++axis)
    if (p.strides[axis] == 1 && std::min(p.shape[axis], p.shape[last]) >= kMinSquares)
      return copy_squares(p, axis, input, output);
  copy_rows(p, input, output);
}

}  // namespace revisit::engine
#endif
