// Max pooling of rows that are made one by one. Included once for each SIMD target.
#if defined(REVISIT_BLOCKED_POOLING_STRIP_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_BLOCKED_POOLING_STRIP_INL_H
#undef REVISIT_BLOCKED_POOLING_STRIP_INL_H
#else
#define REVISIT_BLOCKED_POOLING_STRIP_INL_H
#endif

#include "kernels/blocked/planes.h"
#include "kernels/blocked/pooling-inl.h"
#include "kernels/blocked/pooling_strip.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// The pixels [begin, end) of a row of one image.
struct PixelRange {
  int64_t y, begin, end;
};

/// Some windows side by side, on all rows of one image.
struct StripTask {
  const PoolingProblem& pooling;
  int64_t channels;
  int64_t begin, end;  // windows of a row
  float* output;       // of the image
  float* row;          // scratch: one row of pixels of all channels, at most PoolingStrip::columns

  WindowRange columns(int64_t x) const {
    return window_range(x, pooling.stride_w, pooling.pad_w, pooling.kernel_w, pooling.w);
  }
  WindowRange rows(int64_t y) const {
    return window_range(y, pooling.stride_h, pooling.pad_h, pooling.kernel_h, pooling.h);
  }
  float* output_row(int64_t block, int64_t y) const {
    return output + ((block * pooling.out_h + y) * pooling.out_w + begin) * kLanes;
  }

  /// Adds `count` rows (0 or 1) of pixels from `left` to `right` to row `y` of windows.
  HWY_INLINE void add(int64_t y, int64_t count, bool continued, int64_t left, int64_t right) const {
    for (int64_t block = 0; block < channel_blocks(channels); ++block)
      pool_row<Largest>(pooling, {.in = row + block * (right - left) * kLanes,
                                  .first_column = left,
                                  .row_floats = 0,
                                  .rows = count,
                                  .height = 0,
                                  .begin = begin,
                                  .end = end,
                                  .out = output_row(block, y),
                                  .continued = continued});
  }
};

/// `make_row(range, step)` writes the pixels of the range to `task.row`, `step` floats from block
/// to block; it is called for the rows that some window has, from top to bottom.
template <class MakeRow>
HWY_INLINE void pool_strip(const StripTask& task, const MakeRow& make_row) {
  const PoolingProblem& p = task.pooling;
  const int64_t left = task.columns(task.begin).begin, right = task.columns(task.end - 1).end;
  int64_t first = 0;  // row of windows that may still need the present row
  for (int64_t y = 0; y < p.h; ++y) {
    while (first < p.out_h && task.rows(first).end <= y) ++first;
    if (first == p.out_h || task.rows(first).begin > y) continue;
    make_row(PixelRange{y, left, right}, (right - left) * kLanes);
    for (int64_t out_y = first; out_y < p.out_h && task.rows(out_y).begin <= y; ++out_y)
      task.add(out_y, 1, y > task.rows(out_y).begin, left, right);
  }
  const int64_t last_block = channel_blocks(task.channels) - 1;
  for (int64_t y = 0; y < p.out_h; ++y) {
    if (task.rows(y).begin == task.rows(y).end) task.add(y, 0, false, left, right);
    clear_tail_lanes(task.channels, last_block, task.end - task.begin,
                     task.output_row(last_block, y));
  }
}

}  // namespace
}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard per target
