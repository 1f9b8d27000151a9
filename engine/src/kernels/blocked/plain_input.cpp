#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/blocked/plain_input.cpp"
#include <hwy/foreach_target.h>

#include "kernels/blocked/kernels.h"
#include "kernels/blocked/lrn-inl.h"
#include "kernels/blocked/partition.h"
#include "kernels/blocked/plain_input-inl.h"
#include "kernels/blocked/pooling-inl.h"
#include "revisit/engine/parallel_for.h"

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

/// Scratch has `columns` floats per thread after the patches.
template <class In>
void convolve(const ConvolutionProblem& p, const BlockedConvolutionArguments& a,
              int64_t columns = 0) {
  using Out = std::conditional_t<std::is_same_v<In, float>, float, BFloat16>;
  const PlainInput<In> convolution(p, a);
  const auto* const addend = static_cast<const Out*>(a.addend);
  const int64_t blocks = channel_blocks(p.c_out), step = p.out_pixels() * kLanes;
  const int64_t patch = padded_channels(plain_input_patch_floats(p));
  parallel_for(p.n * p.out_h, p.threads, [&](int64_t item, int thread) {
    const int64_t n = item / p.out_h, y = item % p.out_h;
    const int64_t at = n * blocks * step + y * p.out_w * kLanes;
    float* const scratch = a.scratch + thread * (patch + columns);
    convolution.run_row({n, y, 0, p.out_w, static_cast<Out*>(a.output) + at, p.values, step,
                         addend ? addend + at : nullptr, scratch, scratch + patch});
  });
}

void run_plain_input(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  with_type(p.values, [&](auto type) { convolve<decltype(type)>(p, a); });
}

void run_plain_input_in_tiles(const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
  convolve<TileBf16>(p, a, plain_input_columns_floats(p));
}

void convolve_and_max_pool(const ConvolutionMaxPool& p, const BlockedConvolutionArguments& a) {
  with_type(p.convolution.values, [&](auto type) { convolve_and_pool<decltype(type)>(p, a); });
}

void convolve_in_tiles_and_max_pool(const ConvolutionMaxPool& p,
                                    const BlockedConvolutionArguments& a) {
  convolve_and_pool<TileBf16>(p, a);
}

}  // namespace revisit::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace revisit::engine {
namespace {

HWY_EXPORT(run_plain_input);
HWY_EXPORT(run_plain_input_in_tiles);
HWY_EXPORT(convolve_and_max_pool);
HWY_EXPORT(convolve_in_tiles_and_max_pool);

bool takes_few_channels(const ConvolutionProblem& p) {
  return p.c_in <= 4 && p.group == 1 && plain_input_patch_fits(p);
}

bool goes_in_pairs(const ConvolutionProblem& p) {
  return p.kernel_w > 1 && p.dilation_w == 1;
}

int64_t plain_input_floats(const ConvolutionProblem& p) {
  return channel_blocks(p.c_out) * plain_input_weights(p) * value_bytes(p.values) /
         value_bytes(Precision::kFloat32);
}

/// Writes [output block][input channel][row of taps][step][kLanes][tap of the step], padded with
/// zeros to full tiles.
template <class T, class Convert>
void pack_plain_input(const ConvolutionProblem& p, const float* weights, T* packed,
                      const Convert& convert) {
  constexpr int64_t kStep = std::is_same_v<T, float> ? 1 : 2;
  const int64_t rows = p.c_in * p.kernel_h;
  for (int64_t block = 0; block < channel_blocks(p.c_out); ++block) {
    const T* const end = packed + plain_input_weights(p);
    for (int64_t row = 0; row < rows; ++row)
      for (int64_t step = 0; step < plain_input_steps(p); ++step)
        for (int64_t i = 0; i < kLanes * kStep; ++i) {
          const int64_t co = block * kLanes + i / kStep, first = step * kStep;
          const int64_t kx = std::min(first, p.kernel_w - kStep) + i % kStep;
          *packed++ = co < p.c_out && kx >= first  // else part of the previous step
                          ? convert(weights[(co * rows + row) * p.kernel_w + kx])
                          : T{};
        }
    packed = std::fill_n(packed, end - packed, T{});
  }
}

void pack_values(const ConvolutionProblem& p, const float* weights, float* packed) {
  pack_as(p.values, packed,
          [&](auto* to, const auto& convert) { pack_plain_input(p, weights, to, convert); });
}

}  // namespace

const BlockedConvolutionKernel kBlockedPlainInput = {
    "direct plain-input",
    Layout::kNchw,
    [](const ConvolutionProblem& p) {
      return takes_few_channels(p) && (p.values == Precision::kFloat32 || goes_in_pairs(p));
    },
    plain_input_ms,
    plain_input_floats,
    pack_values,
    [](const ConvolutionProblem& p) {
      return p.threads * padded_channels(plain_input_patch_floats(p));
    },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      REVISIT_DISPATCH(run_plain_input, instructions_for(p.values))(p, a);
    },
    0,
    Products::kValues};

const BlockedConvolutionKernel kBlockedPlainInputTiles = {
    "tiles plain-input",
    Layout::kNchw,
    [](const ConvolutionProblem& p) {
      return p.values == Precision::kBf16 && takes_few_channels(p) && goes_in_pairs(p);
    },
    plain_input_tiles_ms,
    plain_input_floats,
    pack_values,
    [](const ConvolutionProblem& p) {
      return p.threads *
             (padded_channels(plain_input_patch_floats(p)) + plain_input_columns_floats(p));
    },
    [](const ConvolutionProblem& p, const BlockedConvolutionArguments& a) {
      REVISIT_DISPATCH(run_plain_input_in_tiles, Instructions::kTiles)(p, a);
    },
    0,
    Products::kTiles};

void blocked_convolution_max_pool(const ConvolutionMaxPool& p,
                                  const BlockedConvolutionArguments& a) {
  if (p.in_tiles)
    REVISIT_DISPATCH(convolve_in_tiles_and_max_pool, Instructions::kTiles)(p, a);
  else
    REVISIT_DISPATCH(convolve_and_max_pool, instructions_for(p.convolution.values))(p, a);
}

int64_t blocked_convolution_max_pool_scratch_floats(const ConvolutionMaxPool& p) {
  return pieces_of(p).scratch_floats() +
         p.convolution.threads * ConvolutionMaxPoolScratch(p).floats();
}

}  // namespace revisit::engine
#endif
