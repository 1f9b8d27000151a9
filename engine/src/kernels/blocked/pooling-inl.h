#if defined(REVISIT_BLOCKED_POOLING_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCKED_POOLING_INL_H
#undef REVISIT_BLOCKED_POOLING_INL_H
#else
#define REVISIT_BLOCKED_POOLING_INL_H
#endif

#include <algorithm>

#include "kernels/blocked/block-inl.h"
#include "kernels/pooling.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// Clips the range to the image; if it is empty, `begin` equals `end` within the image.
HWY_INLINE WindowRange in_image(WindowRange range, int64_t size) {
  range.begin = std::min(range.begin, size);
  range.end = std::max(range.end, range.begin);
  return range;
}
HWY_INLINE WindowRange rows_of(const PoolingProblem& p, int64_t y) {
  return in_image(p.rows(y), p.h);
}
HWY_INLINE WindowRange columns_of(const PoolingProblem& p, int64_t x) {
  return in_image(p.columns(x), p.w);
}

struct Largest {
  template <class Out>
  static HWY_INLINE Vector first() {
    return hn::Set(
        Tag(), empty_maximum(std::is_same_v<Out, float> ? Precision::kFloat32 : Precision::kBf16));
  }
  /// Ignores NaN: x > best ? x : best.
  static HWY_INLINE Vector add(Vector best, Vector x) {
    if constexpr (kMaxIsFirstIfGreater) return hn::Max(x, best);
    return hn::IfThenElse(hn::Gt(x, best), x, best);
  }
  static HWY_INLINE Vector last(Vector best, float) { return best; }
};

struct Mean {
  template <class>
  static HWY_INLINE Vector first() {
    return hn::Zero(Tag());
  }
  static HWY_INLINE Vector add(Vector sum, Vector x) { return hn::Add(sum, x); }
  static HWY_INLINE Vector last(Vector sum, float area) {
    return hn::Div(sum, hn::Set(Tag(), area));
  }
};

/// Rows of a plane, or some of them, that one row of windows reads, and the destination.
template <class In, class Out>
struct RowOfWindows {
  const In* in;  // first row, from column `first_column`
  int64_t first_column;
  int64_t row_step;
  int64_t rows;
  int64_t height;      // windows' height, clipped to image and padding, for means
  int64_t begin, end;  // range of windows, out of `out_w`
  Out* out;            // window `begin`
  bool continued;      // `out` has results of earlier rows
};

template <class Operation, int kCount, class In, class Out>
HWY_INLINE void pool_windows(const RowOfWindows<In, Out>& row, const In* in, int64_t step,
                             int64_t columns, float area, Out* out) {
  for (int64_t part = 0; part < kLanes; part += kVectorLanes) {
    Vector result[kCount];
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i)
      result[i] =
          row.continued ? load_vector(out + i * kLanes + part) : Operation::template first<Out>();
    for (int64_t y = 0; y < row.rows; ++y)
      for (int64_t x = 0; x < columns; ++x) {
        const In* pixel = in + y * row.row_step + x * kLanes + part;
        REVISIT_UNROLL
        for (int i = 0; i < kCount; ++i)
          result[i] = Operation::add(result[i], load_vector(pixel + i * step));
      }
    REVISIT_UNROLL
    for (int i = 0; i < kCount; ++i)
      store_vector(Operation::last(result[i], area), out + i * kLanes + part);
  }
}

template <class Operation, class In, class Out>
HWY_INLINE void pool_row(const PoolingProblem& p, const RowOfWindows<In, Out>& row) {
  constexpr int kCount = 8;
  // Windows in [whole_begin, whole_end) are horizontally inside the image.
  const int64_t whole_begin = (p.pad_w + p.stride_w - 1) / p.stride_w;
  const int64_t room = p.w + p.pad_w - p.kernel_w;
  const int64_t whole_end = room < 0 ? 0 : room / p.stride_w + 1;
  for (int64_t x = row.begin; x < row.end;) {
    const WindowRange columns = columns_of(p, x);
    const int64_t width = p.width(columns.start);
    const auto run = [&](auto count) HWY_ATTR {
      pool_windows<Operation, decltype(count)::value>(
          row, row.in + (columns.begin - row.first_column) * kLanes, p.stride_w * kLanes,
          columns.end - columns.begin, static_cast<float>(row.height * width),
          row.out + (x - row.begin) * kLanes);
      x += count;
    };
    if (x >= whole_begin && x + kCount <= std::min(whole_end, row.end))
      run(std::integral_constant<int, kCount>());
    else
      run(std::integral_constant<int, 1>());
  }
}

}  // namespace
}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
