#pragma once

#include "kernels/blocked/convolution.h"
#include "layer.h"
#include "weight_cache.h"

namespace revisit::engine {

/// The second blob of a layer, or null where it has none.
const float* bias_of(const std::vector<Tensor>& originals);

/// A 2-D convolution as its blocked kernels see it, input and weights changed by its fusion.
class FusedConvolution {
 public:
  FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion);

  /// With one input channel where that is gray.
  const ConvolutionProblem& problem() const { return problem_; }
  const Fusion& fusion() const { return fusion_; }

  /// Of packed(): the kernel's own for weights and constants, and the bias.
  Bytes packed_size(const BlockedConvolutionKernel& kernel) const;
  /// From `cache`, under `layer`, or made of the layer's weights in the file.
  HeldWeights packed(const BlockedConvolutionKernel& kernel, const std::vector<Tensor>& originals,
                     WeightCache* cache, size_t layer) const;

 private:
  PackedWeightsKey key(size_t layer, std::string kernel) const;
  PackedWeights pack(const BlockedConvolutionKernel& kernel,
                     const std::vector<Tensor>& originals) const;

  ConvolutionProblem problem_;
  Fusion fusion_;
  int64_t c_in_;  // of the weights of the file, of one group
  /// Windows of a gray input reach beyond the image, and its channels differ there: padding is 0 in
  /// every channel of the original, not the offset.
  bool has_constants_;
};

}  // namespace revisit::engine
