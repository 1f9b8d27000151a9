#pragma once

#include "kernels/convolution_nd.h"
#include "layer.h"

/// What convolutions and deconvolutions share.
namespace revisit::engine {

/// Throws InputError unless the outputs can be divided into the groups.
void check_outputs_and_groups(const caffe::ConvolutionParameter& param);

/// Throws InputError unless all inputs have one shape and each has an output of its own.
void check_inputs_and_outputs(const std::vector<Shape>& inputs, size_t n_outputs);

/// The input's axes before the channels, then `channels` and `pixels`.
Shape with_channels(const Shape& input, size_t channel_axis, int64_t channels,
                    const WindowAxes& axes, int64_t WindowAxis::*pixels);

/// The filters; and the bias, one number for each of `outputs` channels.
std::vector<Shape> filters_and_bias(const ConvolutionNdProblem& p,
                                    const caffe::ConvolutionParameter& param, int64_t outputs);

/// Kernel, stride, pad and dilation of a convolution parameter resolved for `n_axes` spatial axes;
/// image and window sizes are left to the caller. Throws InputError for what Caffe refuses.
WindowAxes window_axes(const caffe::ConvolutionParameter& param, size_t n_axes);

/// Windows that fit along an axis of `axis.image` pixels: the output size of a convolution. Integer
/// division truncates toward zero (docs/LAYERS.md point 3): a kernel larger than the padded image
/// by less than the stride still gives one window. Throws InputError when none fits.
int64_t count_windows(const WindowAxis& axis);

/// How many pixels `axis.windows` windows cover, less the padding: the output size of a
/// deconvolution. Throws InputError when none is left.
int64_t count_pixels(const WindowAxis& axis);

/// Layer::window() of these axes.
std::optional<WindowHw> window_of_last_axes(const WindowAxes& axes);

}  // namespace revisit::engine
