#pragma once

#include "fold.h"
#include "kernels/blocked/convolution.h"
#include "layer.h"
#include "weight_cache.h"

namespace revisit::engine {

/// Where the weights of a layer are found.
struct WeightSource {
  std::function<std::shared_ptr<const std::vector<Tensor>>()> originals;  // those of the file
  WeightCache* cache;
  size_t layer;  // that the cache knows it as
};

/// A 2-D convolution as its kernels see it: what its fusion changes about input and weights.
class FusedConvolution {
 public:
  FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion);

  /// With one input channel where that is gray.
  const ConvolutionProblem& problem() const { return problem_; }
  const Fusion& fusion() const { return fusion_; }
  /// Whether padding meets a gray input whose channels differ: FoldedWeights::constants.
  bool has_constants() const { return needs_constants(fusion_, sees_outside_); }

  /// Of packed(): the kernel's own for weights and constants, and the bias.
  int64_t packed_floats(const BlockedConvolutionKernel& kernel) const;
  /// The kernel's own where packed_floats() is at most `limit`.
  int64_t most_packed_floats(int64_t limit) const;
  HeldWeights packed(const BlockedConvolutionKernel& kernel, const WeightSource& source) const;

  /// Weights and bias in the file's order for a kernel on plain values: the file's own, but of a
  /// gray input a copy of plain_floats(). With constants there is a second input channel, of ones,
  /// whose padding is 0 as that of the picture.
  HeldWeights plain(const WeightSource& source) const;
  int64_t plain_floats() const;

 private:
  PackedWeightsKey key(size_t layer, std::string kernel) const;
  FoldedWeights folded(const std::vector<Tensor>& originals) const;

  ConvolutionProblem problem_;
  Fusion fusion_;
  WeightSize weight_size_;
  bool sees_outside_;  // windows reach beyond the image
};

}  // namespace revisit::engine
