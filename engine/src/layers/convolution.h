#pragma once

#include "kernels/blocked/kernels.h"
#include "kernels/convolution.h"
#include "layer.h"

namespace revisit::engine {

/// Resolves kernel, stride, pad and dilation of a convolution parameter for `n_axes` spatial axes;
/// the caller sets image and window sizes. Throws InputError for parameters that Caffe rejects.
WindowAxes window_axes(const caffe::ConvolutionParameter& param, size_t n_axes);

/// Returns the NCHWc kernel for a 2-D convolution with its fusion and input layout. Returns null if
/// no kernel with at most `most_points` transform points pays off; NCHW kernels support all fusions
/// except pooling. Must be called once per operation, because other plans depend on the result.
const BlockedConvolutionKernel* choose_convolution(const ConvolutionProblem& problem,
                                                   const Fusion& fusion, Layout input,
                                                   int most_points);

/// Binds Binding::convolution with all fused operations. Its weights are held, not bound.
Kernel bind_blocked_convolution(ConvolutionProblem problem, const Binding& binding);

/// Expands a single-channel input to all channels, for convolutions without an NCHWc kernel.
Kernel bind_nchw_convolution(const ConvolutionNdProblem& problem, const ConvolutionNdKernel& chosen,
                             const Binding& binding);

}  // namespace revisit::engine
