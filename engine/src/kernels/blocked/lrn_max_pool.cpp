#include "kernels/blocked/lrn.h"
#include "kernels/blocked/pooling_strip.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/lrn_max_pool.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/pooling_strip-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

void lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& p, const float* input, float* output,
                  float* scratch) {
  const LrnSquares layout(lrn);
  const PoolingStrip strip(p, lrn.c);
  const int64_t channels = padded_channels(lrn.c), step = lrn.h * lrn.w * kLanes;
  parallel_for(lrn.n * strip.per_image, p.threads, [&](int64_t item, int thread) HWY_ATTR {
    float* const squares = scratch + thread * (layout.floats() + strip.row_floats);
    float* const row = squares + layout.floats();
    const int64_t n = item / strip.per_image, first = item % strip.per_image * strip.windows;
    const float* image = input + n * channels * lrn.h * lrn.w;
    clear_margins(layout, squares);
    pool_strip({.pooling = p,
                .channels = lrn.c,
                .begin = first,
                .end = std::min(first + strip.windows, p.out_w),
                .output = output + n * channels * p.out_h * p.out_w,
                .row = row},
               [&](const PixelRange& range, int64_t row_step) HWY_ATTR {
                 for (int64_t x = range.begin; x < range.end; x += layout.pixels)
                   normalise(lrn, layout,
                             {.input = image + (range.y * lrn.w + x) * kLanes,
                              .input_step = step,
                              .output = row + (x - range.begin) * kLanes,
                              .output_step = row_step,
                              .pixels = std::min(layout.pixels, range.end - x),
                              .ahead = lrn.w * kLanes,
                              .squares = squares});
               });
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
