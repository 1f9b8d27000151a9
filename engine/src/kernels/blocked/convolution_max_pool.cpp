#include "kernels/blocked/convolution_max_pool.h"

#include "kernels/blocked/pooling_strip.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/convolution_max_pool.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/plain_input-inl.h"
#include "kernels/blocked/plain_input_scratch.h"
#include "kernels/blocked/pooling_strip-inl.h"

namespace revisit::engine {
#ifndef REVISIT_CONVOLUTION_MAX_POOL_SCRATCH
#define REVISIT_CONVOLUTION_MAX_POOL_SCRATCH
namespace {

/// What one thread needs, one behind the other.
struct ConvolutionMaxPoolScratch {
  int64_t patch, row, squares;

  explicit ConvolutionMaxPoolScratch(const ConvolutionMaxPool& p)
      : patch(padded_channels(plain_input_patch_floats(p.convolution))),
        row(PoolingStrip(p.pooling, p.convolution.c_out).row_floats),
        squares(p.lrn ? LrnSquares(*p.lrn).floats() : 0) {}

  int64_t floats() const { return patch + row + squares; }
};

}  // namespace
#endif
}  // namespace revisit::engine

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

void convolution_max_pool(const ConvolutionMaxPool& p, const BlockedConvolutionArguments& a) {
  const PlainInput convolution(p.convolution, a);
  const ConvolutionMaxPoolScratch size(p);
  const int64_t c = p.convolution.c_out;
  const PoolingStrip strip(p.pooling, c);
  parallel_for(
      p.convolution.n * strip.per_image, p.convolution.threads,
      [&](int64_t item, int thread) HWY_ATTR {
        float* const patch = a.scratch + thread * size.floats();
        float* const row = patch + size.patch;
        float* const squares = row + size.row;
        if (p.lrn) clear_margins(LrnSquares(*p.lrn), squares);
        const int64_t n = item / strip.per_image, first = item % strip.per_image * strip.windows;
        pool_strip({.pooling = p.pooling,
                    .channels = c,
                    .begin = first,
                    .end = std::min(first + strip.windows, p.pooling.out_w),
                    .output = a.output + n * padded_channels(c) * p.pooling.out_h * p.pooling.out_w,
                    .row = row},
                   [&](const PixelRange& range, int64_t step) HWY_ATTR {
                     convolution.run_row({.n = n,
                                          .y = range.y,
                                          .begin = range.begin,
                                          .end = range.end,
                                          .output = row,
                                          .output_step = step,
                                          .addend = nullptr,
                                          .patch = patch});
                     if (!p.lrn) return;
                     const LrnSquares layout(*p.lrn);
                     for (int64_t x = 0; x < range.end - range.begin; x += layout.pixels)
                       normalise(*p.lrn, layout,
                                 {.input = row + x * kLanes,
                                  .input_step = step,
                                  .output = row + x * kLanes,
                                  .output_step = step,
                                  .pixels = std::min(layout.pixels, range.end - range.begin - x),
                                  .ahead = 0,
                                  .squares = squares});
                   });
      });
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {

HWY_EXPORT(convolution_max_pool);

void blocked_convolution_max_pool(const ConvolutionMaxPool& p,
                                  const BlockedConvolutionArguments& arguments) {
  HWY_DYNAMIC_DISPATCH(convolution_max_pool)(p, arguments);
}

int64_t blocked_convolution_max_pool_scratch_floats(const ConvolutionMaxPool& p) {
  return p.convolution.threads * ConvolutionMaxPoolScratch(p).floats();
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
