#pragma once

#include <cstdint>
#include <span>

#include "kernels/window.h"
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

/// Cross-correlation over any number of spatial axes: images `[n][c_image][image...]`, weights
/// `[c_windows][c_image / group][kernel...]`, windows `[n][c_windows][windows...]`. Convolution
/// maps images to windows; deconvolution, its adjoint, maps windows to images.
struct ConvolutionNdProblem {
  int64_t n = 1, c_image = 1, c_windows = 1, group = 1;
  WindowAxes axes;
  int threads = 1;

  int64_t c_image_per_group() const { return c_image / group; }
  int64_t c_windows_per_group() const { return c_windows / group; }
  int64_t image_pixels() const { return product_of(axes, &WindowAxis::image); }
  int64_t windows() const { return product_of(axes, &WindowAxis::windows); }
  int64_t kernel_elements() const { return product_of(axes, &WindowAxis::kernel); }
  int64_t depth() const { return c_image_per_group() * kernel_elements(); }
  int64_t macs() const { return n * c_windows * windows() * depth(); }
};

/// The bias has one value per output channel, or is null.
struct ConvolutionNdKernel {
  const char* name;
  bool (*supports)(const ConvolutionNdProblem&);
  int64_t (*scratch_floats)(const ConvolutionNdProblem&);
  void (*run)(const ConvolutionNdProblem&, const float* input, const float* weights,
              const float* bias, float* output, float* scratch);
  bool uses_blas = false;
};

inline bool always(const ConvolutionNdProblem&) {
  return true;
}
inline int64_t no_scratch(const ConvolutionNdProblem&) {
  return 0;
}

/// Convolution kernels in order of preference; the last is the reference and supports everything.
std::span<const ConvolutionNdKernel> convolution_kernels();

extern const ConvolutionNdKernel kConvolutionReference;    // direct, in double precision
extern const ConvolutionNdKernel kDeconvolutionGemm;       // matrix products and col2im in tiles
extern const ConvolutionNdKernel kDeconvolutionReference;  // direct, in double precision

}  // namespace revisit::engine
