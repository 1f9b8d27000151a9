#pragma once

#include "kernels/blocked/kernels.h"
#include "kernels/convolution.h"
#include "layer.h"
#include "weight_cache.h"

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

const float* bias_of(const std::vector<Tensor>& originals);

class FusedConvolution {
 public:
  FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion);

  /// Has one input channel if the input has a single channel.
  const ConvolutionProblem& problem() const { return problem_; }
  const Fusion& fusion() const { return fusion_; }

  Bytes packed_size(const BlockedConvolutionKernel& kernel) const;
  /// Returns the weights from `cache`, under `layer`, or packs the layer's weights.
  HeldWeights packed(const BlockedConvolutionKernel& kernel, const std::vector<Tensor>& originals,
                     WeightCache* cache, size_t layer) const;

 private:
  PackedWeightsKey key(size_t layer, std::string kernel) const;
  PackedWeights pack(const BlockedConvolutionKernel& kernel,
                     const std::vector<Tensor>& originals) const;

  ConvolutionProblem problem_;
  Fusion fusion_;
  int64_t c_in_;  // channels of the file's weights, per group
  /// True if windows of a single-channel input reach beyond the image, where all original channels
  /// are 0 instead of their offset.
  bool has_constants_;
};

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
