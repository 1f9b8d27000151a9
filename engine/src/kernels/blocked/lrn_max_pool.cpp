#include "kernels/blocked/lrn.h"
#include "kernels/blocked/planes.h"
#include "kernels/blocked/pooling_strip.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/lrn_max_pool.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/pooling-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {
namespace {

/// One strip of one image. `row` is scratch for one row of it, normalised.
struct LrnPoolStrip {
  const LrnProblem& lrn;
  const PoolingProblem& pooling;
  const LrnSquares& squares_layout;
  const float* input;  // of the image
  float* output;       // of the image
  int64_t begin, end;  // windows
  float* squares;
  float* row;

  int64_t left =
      window_range(begin, pooling.stride_w, pooling.pad_w, pooling.kernel_w, pooling.w).begin;
  int64_t right =
      window_range(end - 1, pooling.stride_w, pooling.pad_w, pooling.kernel_w, pooling.w).end;
  int64_t blocks = channel_blocks(lrn.c);

  HWY_INLINE void normalise_row(int64_t y) const {
    const int64_t in_step = lrn.h * lrn.w * kLanes, out_step = (right - left) * kLanes;
    for (int64_t x = left; x < right; x += squares_layout.pixels)
      normalise(lrn, squares_layout,
                {input + (y * lrn.w + x) * kLanes, in_step, row + (x - left) * kLanes, out_step,
                 std::min(squares_layout.pixels, right - x), lrn.w * kLanes, squares});
  }

  /// Adds `rows` (0 or 1) rows to row `y` of windows.
  HWY_INLINE void pool(int64_t y, int64_t rows, bool continued) const {
    for (int64_t block = 0; block < blocks; ++block)
      pool_row<Largest>(pooling, {.in = row + block * (right - left) * kLanes,
                                  .first_column = left,
                                  .row_floats = 0,
                                  .rows = rows,
                                  .height = 0,
                                  .begin = begin,
                                  .end = end,
                                  .out = output_row(block, y),
                                  .continued = continued});
  }

  float* output_row(int64_t block, int64_t y) const {
    return output + ((block * pooling.out_h + y) * pooling.out_w + begin) * kLanes;
  }
};

void run_strip(const LrnPoolStrip& strip) {
  const PoolingProblem& p = strip.pooling;
  const auto rows_of = [&](int64_t out_y) HWY_ATTR {
    return window_range(out_y, p.stride_h, p.pad_h, p.kernel_h, p.h);
  };
  int64_t first = 0;  // row of windows that may still need the present row
  for (int64_t y = 0; y < p.h; ++y) {
    while (first < p.out_h && rows_of(first).end <= y) ++first;
    if (first == p.out_h || rows_of(first).begin > y) continue;
    strip.normalise_row(y);
    for (int64_t out_y = first; out_y < p.out_h && rows_of(out_y).begin <= y; ++out_y)
      strip.pool(out_y, 1, y > rows_of(out_y).begin);
  }
  for (int64_t out_y = 0; out_y < p.out_h; ++out_y) {
    if (rows_of(out_y).begin == rows_of(out_y).end) strip.pool(out_y, 0, false);
    clear_tail_lanes(strip.lrn.c, strip.blocks - 1, strip.end - strip.begin,
                     strip.output_row(strip.blocks - 1, out_y));
  }
}

}  // namespace

void lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& p, const float* input, float* output,
                  float* scratch) {
  const LrnSquares squares(lrn);
  const PoolingStrip strip(p, lrn.c);
  const int64_t channels = padded_channels(lrn.c),
                strips = (p.out_w + strip.windows - 1) / strip.windows;
  parallel_for(lrn.n * strips, p.threads, [&](int64_t item, int thread) HWY_ATTR {
    float* const mine = scratch + thread * (squares.floats() + strip.columns * channels);
    const int64_t image = item / strips, begin = item % strips * strip.windows;
    clear_margins(squares, mine);
    run_strip({.lrn = lrn,
               .pooling = p,
               .squares_layout = squares,
               .input = input + image * channels * lrn.h * lrn.w,
               .output = output + image * channels * p.out_h * p.out_w,
               .begin = begin,
               .end = std::min(begin + strip.windows, p.out_w),
               .squares = mine,
               .row = mine + squares.floats()});
  });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(lrn_max_pool);

int64_t blocked_lrn_max_pool_scratch_floats(const LrnProblem& lrn, const PoolingProblem& pooling) {
  return pooling.threads *
         (LrnSquares(lrn).floats() + PoolingStrip(pooling, lrn.c).columns * padded_channels(lrn.c));
}

void blocked_lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& pooling, const float* input,
                          float* output, float* scratch) {
  HWY_DYNAMIC_DISPATCH(lrn_max_pool)(lrn, pooling, input, output, scratch);
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
