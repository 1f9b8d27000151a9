#pragma once

#include "kernels/blocked/column_panels.h"
#include "kernels/convolution.h"

namespace revisit::engine {

/// The pixels that a tile sees of a row. Strides, kernels and dilations are below 2^31.
inline int64_t plain_input_span(const ConvolutionProblem& p) {
  return (kMaxColumns - 1) * p.stride_w + (p.kernel_w - 1) * p.dilation_w + 1;
}

/// What a thread copies of the input where a tile of pixels reaches over its border.
inline int64_t plain_input_patch_floats(const ConvolutionProblem& p) {
  return p.c_in * p.kernel_h * plain_input_span(p);
}

/// False for strides and kernels beyond all use, whose patches would take gigabytes, or more floats
/// than can be counted.
inline bool plain_input_patch_fits(const ConvolutionProblem& p) {
  constexpr int64_t kMostFloats = 1 << 24;
  int64_t floats = 0;
  return !__builtin_mul_overflow(p.c_in * p.kernel_h, plain_input_span(p), &floats) &&
         floats <= kMostFloats;
}

}  // namespace revisit::engine
