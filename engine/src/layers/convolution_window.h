#pragma once

#include "kernels/convolution_nd.h"
#include "layer.h"

namespace revisit::engine {

/// Throws InputError unless the number of outputs is a multiple of the groups.
void check_outputs_and_groups(const caffe::ConvolutionParameter& param);

/// Throws InputError unless all inputs have one shape and each has its own output.
void check_inputs_and_outputs(const std::vector<Shape>& inputs, size_t n_outputs);

Shape with_channels(const Shape& input, size_t channel_axis, int64_t channels,
                    const WindowAxes& axes, int64_t WindowAxis::*pixels);

std::vector<Shape> filters_and_bias(const ConvolutionNdProblem& p,
                                    const caffe::ConvolutionParameter& param, int64_t outputs);

/// Resolves kernel, stride, pad and dilation of a convolution parameter for `n_axes` spatial axes;
/// the caller sets image and window sizes. Throws InputError for parameters that Caffe rejects.
WindowAxes window_axes(const caffe::ConvolutionParameter& param, size_t n_axes);

/// Divides toward zero (docs/LAYERS.md point 3), so a kernel that exceeds the padded image by less
/// than the stride yields one window. Throws InputError if none fits.
int64_t count_windows(const WindowAxis& axis);

/// Excludes the padding. Throws InputError if no pixel is left.
int64_t count_pixels(const WindowAxis& axis);

std::optional<WindowHw> window_of_last_axes(const WindowAxes& axes);

}  // namespace revisit::engine
