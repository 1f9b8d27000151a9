#pragma once

#include <cstdint>

#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// A 2-D cross-correlation (Caffe's convolution): input `[n][c_in][h][w]`, weights
/// `[c_out][c_in / group][kernel_h][kernel_w]`, bias `[c_out]` or null, output
/// `[n][c_out][out_h][out_w]`. Rows and columns outside the input read as zero.
struct ConvolutionProblem {
  int64_t n = 1, c_in = 1, h = 1, w = 1;
  int64_t c_out = 1, out_h = 1, out_w = 1;
  int64_t kernel_h = 1, kernel_w = 1, stride_h = 1, stride_w = 1;
  int64_t pad_h = 0, pad_w = 0, dilation_h = 1, dilation_w = 1;
  int64_t group = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;  // NCHWc arrays

  int64_t c_in_per_group() const { return c_in / group; }
  int64_t c_out_per_group() const { return c_out / group; }
  int64_t depth() const { return c_in_per_group() * kernel_h * kernel_w; }
  int64_t out_pixels() const { return out_h * out_w; }
  int64_t macs() const { return n * c_out * out_pixels() * depth(); }
};

}  // namespace revisit::engine
