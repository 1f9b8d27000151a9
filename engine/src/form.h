#pragma once

#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "aligned.h"
#include "kernels/blocked/elementwise.h"
#include "kernels/convolution.h"
#include "kernels/epilogue.h"
#include "kernels/lrn.h"
#include "kernels/pooling.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

// Forms say what a layer computes, for layers that can be merged with their neighbours (fuse.h) or
// have kernels on blocked values (bind_operation.h).

/// Sums of products over the channels of `[n][c][h][w]`, which can take a Fusion.
struct Convolving {
  ConvolutionProblem problem;
};

/// A function of each element.
struct Activating {
  Epilogue epilogue;
  std::shared_ptr<const AlignedFloats> slopes = nullptr;  // kPrelu: those of the epilogue
};

/// scale[c] * x + shift[c] on `[n][c]...`.
struct ChannelAffine {
  std::vector<double> scale, shift;
};

/// Inputs of one shape, element by element.
struct Combining {
  BlockedEltwise::Operation operation;
  std::vector<float> coefficients;  // of a sum, one for each input
};

/// a[n][c] * x, plus y where there is one: which inputs these are.
struct Gating {
  size_t x = 0, factors = 0;
  std::optional<size_t> addend = std::nullopt;
  bool zero_hides = false;  // BlockedGate::zero_hides
};

/// Means of windows.
struct Averaging {
  PoolingProblem problem;
};

/// Images one after another, along the channels.
struct Joining {};

/// The input cut into the outputs, along the channels.
struct Cutting {};

/// Channel c of the output is channel sources[c] of the input.
struct Shuffling {
  std::vector<int64_t> sources;
};

using Form = std::variant<std::monostate, Convolving, Activating, ChannelAffine, Combining, Gating,
                          LrnProblem /* across channels */, PoolingProblem /* maximum */, Averaging,
                          Joining, Cutting, Shuffling>;

/// What an operation does beside what its layer says, in this order. All of it is for convolutions;
/// ChannelAffine takes scale and shift and activations, Combining activations, Gating an addend and
/// activations, LrnProblem pooling.
struct Fusion {
  /// The input holds one channel, x, which stands for channels x + offset.
  std::optional<std::vector<float>> gray_offsets;
  std::optional<ChannelAffine> affine;
  std::vector<size_t> affine_layers;  // that it comes from: indices into Graph::nodes
  bool adds_last_input = false;       // of the shape of the output
  Activating activation;
  std::optional<LrnProblem> lrn;          // only with pooling
  std::optional<PoolingProblem> pooling;  // maximum
};

/// `next` after `first`.
inline ChannelAffine composed(ChannelAffine first, const ChannelAffine& next) {
  for (size_t c = 0; c < first.scale.size(); ++c) {
    first.scale[c] *= next.scale[c];
    first.shift[c] = first.shift[c] * next.scale[c] + next.shift[c];
  }
  return first;
}

}  // namespace revisit::engine
