#pragma once

#include "kernels/blocked/convolution.h"
#include "layer.h"
#include "weight_cache.h"

namespace revisit::engine {

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

}  // namespace revisit::engine
