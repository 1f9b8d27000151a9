#pragma once

#include <cstdint>
#include <span>

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

  int64_t c_in_per_group() const { return c_in / group; }
  int64_t c_out_per_group() const { return c_out / group; }
  /// Length of the dot product behind one output.
  int64_t depth() const { return c_in_per_group() * kernel_h * kernel_w; }
  int64_t out_pixels() const { return out_h * out_w; }
  int64_t macs() const { return n * c_out * out_pixels() * depth(); }
};

struct ConvolutionKernel {
  const char* name;
  bool (*supports)(const ConvolutionProblem&);
  int64_t (*scratch_floats)(const ConvolutionProblem&);
  void (*run)(const ConvolutionProblem&, const float* input, const float* weights,
              const float* bias, float* output, float* scratch);
};

/// In order of preference; the last is the reference and supports everything.
std::span<const ConvolutionKernel> convolution_kernels();

// The kernels, one a file.
extern const ConvolutionKernel
    kConvolutionPointwiseGemm;  // 1x1, stride 1: a matrix product on the input itself
extern const ConvolutionKernel
    kConvolutionIm2colGemm;  // strips of columns unfolded, then a matrix product
extern const ConvolutionKernel kConvolutionReference;  // the definition, in double precision

}  // namespace revisit::engine
