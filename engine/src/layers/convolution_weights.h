#pragma once

#include "fold.h"
#include "kernels/blocked/convolution.h"
#include "layer.h"
#include "weight_cache.h"

namespace revisit::engine {

/// A 2-D convolution as its kernels see it: what its fusion changes about input and weights.
class FusedConvolution {
 public:
  /// `weights` and `bias` are those of the file; `weights` is null when the net is only inspected,
  /// `bias` when there is none.
  FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion, const float* weights,
                   const float* bias);

  /// With one input channel where that is gray.
  const ConvolutionProblem& problem() const { return problem_; }
  const Fusion& fusion() const { return fusion_; }
  /// Whether padding meets a gray input whose channels differ: FoldedWeights::constants.
  bool has_constants() const { return needs_constants(fusion_, sees_outside_); }

  int64_t packed_floats(const BlockedConvolutionKernel& kernel) const;
  /// Null when the net is only inspected.
  std::shared_ptr<const PackedWeights> pack(const BlockedConvolutionKernel& kernel,
                                            const Binding& binding) const;

  /// Weights and bias in the file's order, in arrays of their own where the fusion changes them.
  struct Plain {
    const float* weights;
    const float* bias;
    std::shared_ptr<const PackedWeights> owner;
    int64_t packed_floats;
  };
  /// For a kernel on plain values. With constants there is a second input channel, of ones, whose
  /// padding is 0 as that of the picture.
  Plain plain(const Binding& binding) const;

 private:
  PackedWeightsKey key(size_t layer, std::string kernel) const;
  FoldedWeights folded() const {
    return fold(fusion_, weight_size_, sees_outside_, weights_, bias_);
  }

  ConvolutionProblem problem_;
  const Fusion& fusion_;
  WeightSize weight_size_;
  bool sees_outside_;  // windows reach beyond the image
  const float* weights_;
  const float* bias_;
};

}  // namespace revisit::engine
