#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "kernels/epilogue.h"
#include "kernels/lrn.h"
#include "kernels/pooling.h"
#include "revisit/engine/tensor.h"

namespace revisit::engine {

// What a layer computes, for layers that can be merged with their neighbours (fuse.h).

/// Sums of products over the channels of `[n][c][h][w]`, which can take a Fusion.
struct Convolving {
  int64_t group = 1;
};

/// A function of each element.
struct Activating {
  Epilogue epilogue;          // its slopes are null
  std::vector<float> slopes;  // kPrelu: [c]
};

/// scale[c] * x + shift[c] on `[n][c]...`.
struct ChannelAffine {
  std::vector<double> scale, shift;
};

/// The sum of two inputs of one shape.
struct Adding {};

using Form = std::variant<std::monostate, Convolving, Activating, ChannelAffine, Adding,
                          LrnProblem /* across channels */, PoolingProblem /* maximum */>;

/// What a convolution does beside its own sums, in this order: all channels of its input are one
/// picture (`gray_offsets`), scale and shift, an addend, an activation.
struct Fusion {
  /// The input holds one channel, x, which stands for channels x + offset.
  std::optional<std::vector<float>> gray_offsets;
  std::optional<ChannelAffine> affine;
  std::vector<size_t> affine_layers;  // that it comes from: indices into Graph::nodes
  bool adds_last_input = false;       // of the shape of the output
  Activating activation;
};

}  // namespace revisit::engine
