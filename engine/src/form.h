#pragma once

#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "aligned.h"
#include "kernels/blocked/kernels.h"
#include "kernels/convolution.h"
#include "kernels/epilogue.h"
#include "kernels/nchw.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

// Forms describe layers that can be fused (fuse.cpp) or have NCHWc kernels (bind_operation.h).

/// Convolution over the channels of `[n][c][h][w]`, which can take a Fusion.
struct Convolving {
  ConvolutionProblem problem;
};

struct Activating {
  Epilogue epilogue;
  std::shared_ptr<const AlignedFloats> slopes = nullptr;  // kPrelu: owner of the epilogue's slopes
};

/// scale[c] * x + shift[c] on `[n][c]...`.
struct ChannelAffine {
  std::vector<double> scale, shift;
};

struct Combining {
  BlockedEltwise::Operation operation;
  std::vector<float> coefficients;  // one per input of a sum
};

/// a[n][c] * x, plus an optional y: indices of these inputs.
struct Gating {
  size_t x = 0, factors = 0;
  std::optional<size_t> addend = std::nullopt;
  bool zero_hides = false;  // BlockedGate::zero_hides
};

struct Averaging {
  PoolingProblem problem;
};

/// Joining and Cutting act along the channels.
struct Joining {};

struct Cutting {};

/// Channel c of the output is channel sources[c] of the input.
struct Shuffling {
  std::vector<int64_t> sources;
};

using Form = std::variant<std::monostate, Convolving, Activating, ChannelAffine, Combining, Gating,
                          LrnProblem /* across channels */, PoolingProblem /* maximum */, Averaging,
                          Joining, Cutting, Shuffling>;

/// Operations fused into an operation, in this order. Convolving supports all, ChannelAffine
/// supports affine and activation, Combining activation, Gating an addend and activation,
/// LrnProblem pooling.
struct Fusion {
  /// The input has one channel x that represents channels x + offset.
  std::optional<std::vector<float>> channel_offsets;
  std::optional<ChannelAffine> affine;
  std::vector<size_t> affine_layers;  // indices into Graph::nodes
  bool adds_last_input = false;       // the last input has the shape of the output
  Activating activation;
  std::optional<LrnProblem> lrn;  // only with pooling
  std::optional<PoolingProblem> pooling;
};

inline ChannelAffine composed(ChannelAffine first, const ChannelAffine& next) {
  for (size_t c = 0; c < first.scale.size(); ++c) {
    first.scale[c] *= next.scale[c];
    first.shift[c] = first.shift[c] * next.scale[c] + next.shift[c];
  }
  return first;
}

}  // namespace revisit::engine
