#pragma once

#include "kernels/blocked/columns.h"
#include "kernels/convolution.h"

namespace revisit::engine {

/// What a thread copies of the input where a tile of pixels reaches over its border.
inline int64_t plain_input_patch_floats(const ConvolutionProblem& p) {
  const int64_t span = (kMaxColumns - 1) * p.stride_w + (p.kernel_w - 1) * p.dilation_w + 1;
  return p.c_in * p.kernel_h * span;
}

}  // namespace revisit::engine
