#pragma once

#include <optional>

#include "model.h"

namespace revisit::bench {

/// One step of an engine that does what can be done together: a layer, and those behind it that
/// went into it.
struct Operation {
  const ModelLayer* layer;
  std::vector<size_t> inputs;  // values
  size_t output;
  std::vector<float> weights, bias;  // of Convolution and InnerProduct
  std::optional<float> relu;         // slope for negative values
  std::optional<size_t> addend;      // a value added before the ReLU; nothing reads it afterwards
};

/// BatchNorm and Scale go into the weights of the convolution before them, a sum into the later of
/// its convolutions, ReLU into what makes its input; Dropout goes. `gray`: the first convolution's
/// weights are summed over the input channels.
std::vector<Operation> fold(const Model& model, bool gray);

}  // namespace revisit::bench
