#include "kernels/blocked/convolution_max_pool.h"

#include "kernels/blocked/pooling_pieces.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/convolution_max_pool.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h.
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/plain_input-inl.h"
#include "kernels/blocked/plain_input_scratch.h"
#include "kernels/blocked/pooling_pieces-inl.h"

namespace revisit::engine {
#ifndef REVISIT_CONVOLUTION_MAX_POOL_SCRATCH
#define REVISIT_CONVOLUTION_MAX_POOL_SCRATCH
namespace {

PoolingPieces pieces_of(const ConvolutionMaxPool& p) {
  return {p.pooling, p.convolution.c_out, p.convolution.threads};
}

/// What one thread needs beside the pieces', one behind the other.
struct ConvolutionMaxPoolScratch {
  int64_t patch, columns, squares;

  explicit ConvolutionMaxPoolScratch(const ConvolutionMaxPool& p)
      : patch(padded_channels(plain_input_patch_floats(p.convolution))),
        columns(p.in_tiles ? plain_input_columns_floats(p.convolution) : 0),
        squares(p.lrn ? LrnSquares(*p.lrn).floats() : 0) {}

  int64_t floats() const { return patch + columns + squares; }
};

}  // namespace
#endif
}  // namespace revisit::engine

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

template <class T>
void convolve_and_pool(const ConvolutionMaxPool& p, const BlockedConvolutionArguments& a) {
  const PlainInput<T, float> convolution(p.convolution, a);
  const ConvolutionMaxPoolScratch size(p);
  const PoolingPieces pieces = pieces_of(p);
  float* const scratch = a.scratch + pieces.scratch_floats();
  const auto rows_of = [&](int64_t image, int thread) HWY_ATTR {
    float* const patch = scratch + thread * size.floats();
    float* const columns = patch + size.patch;
    float* const squares = columns + size.columns;
    if (p.lrn) clear_margins(LrnSquares(*p.lrn), squares);
    return [&, image, patch, columns, squares](const PixelRange& range, float* row,
                                               int64_t step) HWY_ATTR {
      convolution.run_row({.n = image,
                           .y = range.y,
                           .begin = range.begin,
                           .end = range.end,
                           .output = row,
                           .output_step = step,
                           .addend = nullptr,
                           .patch = patch,
                           .columns = columns});
      if (!p.lrn) return;
      const LrnSquares layout(*p.lrn);
      for (int64_t x = 0; x < range.end - range.begin; x += layout.pixels)
        normalise(
            *p.lrn, layout,
            LrnTile<float, float>{.input = row + x * kLanes,
                                  .input_step = step,
                                  .output = row + x * kLanes,
                                  .output_step = step,
                                  .pixels = std::min(layout.pixels, range.end - range.begin - x),
                                  .ahead = 0,
                                  .squares = squares});
    };
  };
  pool_pieces(p.pooling, p.convolution.c_out, pieces, static_cast<T*>(a.output), a.scratch,
              rows_of);
}

void convolution_max_pool(const ConvolutionMaxPool& p, const BlockedConvolutionArguments& a) {
  const auto run = [&](auto type) { convolve_and_pool<decltype(type)>(p, a); };
  p.in_tiles ? with_tile_type(run) : with_type(p.convolution.values, run);
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
  return pieces_of(p).scratch_floats() +
         p.convolution.threads * ConvolutionMaxPoolScratch(p).floats();
}

}  // namespace revisit::engine
#endif  // HWY_ONCE
