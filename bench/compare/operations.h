#pragma once

#include <optional>

#include "model.h"

namespace revisit::bench {

/// One step of an engine: a layer with the later layers that are fused into it.
struct Operation {
  const ModelLayer* layer;
  std::vector<size_t> inputs;  // values
  size_t output;
  std::vector<float> weights, bias;  // of Convolution and InnerProduct
  std::optional<float> relu;         // slope for negative values
  std::optional<size_t> addend;      // a value added before the ReLU; nothing reads it afterwards
};

/// Folds BatchNorm and Scale into the preceding convolution's weights, a sum into the later of its
/// convolutions, ReLU into the producer of its input; removes Dropout. `gray` sums the first
/// convolution's weights over the input channels.
std::vector<Operation> fold(const Model& model, bool gray);

}  // namespace revisit::bench
