#pragma once

#include "kernels/window.h"
#include "layer.h"

namespace revisit::engine {

/// Kernel, stride, pad and dilation of a convolution parameter resolved for `n_axes` spatial axes;
/// image and window sizes are left to the caller. Throws InputError for what Caffe refuses.
WindowAxes window_axes(const caffe::ConvolutionParameter& param, size_t n_axes);

/// How many windows fit along an axis of `axis.image` pixels: the output size of a convolution.
/// Integer division truncates toward zero (SEMANTICS section 3): a kernel that is larger than the
/// padded image by less than the stride still gives one window. Throws InputError for none.
int64_t count_windows(const WindowAxis& axis);

/// How many pixels `axis.windows` windows cover, less the padding: the output size of a
/// deconvolution. Throws InputError for none.
int64_t count_pixels(const WindowAxis& axis);

/// Layer::window() of these axes.
std::optional<WindowHw> window_of_last_axes(const WindowAxes& axes);

}  // namespace revisit::engine
