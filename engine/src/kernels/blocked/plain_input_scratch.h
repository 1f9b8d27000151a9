#pragma once

#include "kernels/blocked/column_panels.h"
#include "kernels/blocked/tile_shape.h"
#include "kernels/convolution.h"
#include "layout.h"

namespace revisit::engine {

/// Input pixels of a row for `outputs` outputs. Strides, kernels and dilations are below 2^31.
inline int64_t plain_input_span(const ConvolutionProblem& p, int64_t outputs) {
  return (outputs - 1) * p.stride_w + (p.kernel_w - 1) * p.dilation_w + 1;
}

/// Products per kernel row: BFloat16 are multiplied in pairs. With an odd number, the last pair
/// repeats its first tap with weight 0.
inline int64_t plain_input_steps(const ConvolutionProblem& p) {
  return p.values == Precision::kBf16 ? (p.kernel_w + 1) / 2 : p.kernel_w;
}

/// Weights per output block; bfloat16 is padded to full tiles for every kernel.
inline int64_t plain_input_weights(const ConvolutionProblem& p) {
  const int64_t steps = p.c_in * p.kernel_h * plain_input_steps(p);
  if (p.values == Precision::kFloat32) return steps * kLanes;
  return Split{2 * steps, 1, kTileDepth}.widest() * kLanes;
}

inline int64_t plain_input_pitch(const ConvolutionProblem& p) {
  return padded_channels(plain_input_span(p, p.out_w));
}

/// Floats that a thread copies: input under a tile at the border or, if rounded, under a row.
inline int64_t plain_input_patch_floats(const ConvolutionProblem& p) {
  return p.c_in * p.kernel_h *
         (p.values == Precision::kBf16 ? plain_input_pitch(p) / 2
                                       : plain_input_span(p, kMaxColumns));
}

/// Floats that a thread unfolds for tiles: the input under a panel of pixels.
inline int64_t plain_input_columns_floats(const ConvolutionProblem& p) {
  return kTilePanel.columns * plain_input_weights(p) / kLanes / 2;
}

/// Returns false for extreme strides and kernels, whose patches would take gigabytes.
inline bool plain_input_patch_fits(const ConvolutionProblem& p) {
  constexpr int64_t kMaxFloats = 1 << 24;
  int64_t floats = 0;
  return !__builtin_mul_overflow(p.c_in * p.kernel_h,
                                 plain_input_span(p, std::max(kMaxColumns, p.out_w)), &floats) &&
         floats <= kMaxFloats;
}

}  // namespace revisit::engine
