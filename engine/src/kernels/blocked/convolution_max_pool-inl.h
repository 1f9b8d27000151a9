// Fuses convolution and pooling row by row. Included once per target.
#if defined(REVISIT_CONVOLUTION_MAX_POOL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef REVISIT_CONVOLUTION_MAX_POOL_INL_H_
#undef REVISIT_CONVOLUTION_MAX_POOL_INL_H_
#else
#define REVISIT_CONVOLUTION_MAX_POOL_INL_H_
#endif

#include "kernels/blocked/convolution_max_pool_scratch.h"
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/plain_input-inl.h"
#include "kernels/blocked/pooling_pieces-inl.h"

HWY_BEFORE_NAMESPACE();
namespace revisit::engine::HWY_NAMESPACE {

template <class In>
void convolve_and_pool(const ConvolutionMaxPool& p, const BlockedConvolutionArguments& a) {
  const PlainInput<In> convolution(p.convolution, a);
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
                           .values = Precision::kFloat32,
                           .output_step = step,
                           .addend = nullptr,
                           .patch = patch,
                           .columns = columns});
      if (!p.lrn) return;
      const LrnSquares layout(*p.lrn);
      for (int64_t x = 0; x < range.end - range.begin; x += layout.pixels)
        normalize(
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
  using Out = std::conditional_t<std::is_same_v<In, float>, float, BFloat16>;
  pool_pieces(p.pooling, p.convolution.c_out, pieces, static_cast<Out*>(a.output), a.scratch,
              rows_of);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
