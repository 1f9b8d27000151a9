#pragma once

#include <span>

#include "kernels/window.h"

namespace revisit::engine {

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
