#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "kernels/blocked/convolution.h"
#include "net_impl.h"

namespace revisit::engine {

/// What runs as one: a layer, with the layers around it that it does the work of.
struct Operation {
  size_t node;                   // the layer it is listed under: index into Graph::nodes
  std::vector<size_t> absorbed;  // the other layers
  std::reference_wrapper<const Layer> layer;
  Form form;  // the layer's, for these inputs
  std::vector<ValueId> inputs, outputs;
  Fusion fusion = {};
  /// Of a convolution: its kernel's limit, see limit_rounding().
  int most_winograd_points = kAnyPoints;
  /// Of a convolution, where something is merged that only this kernel can do: the choice is made
  /// once, here or (null) when the operation is scheduled.
  const BlockedConvolutionKernel* convolution = nullptr;
};

/// The layers of a net as operations, in execution order; Input layers are not among them.
struct Operations {
  std::vector<Operation> list;
  /// The value that holds the numbers of each: itself, unless its layer changes nothing.
  std::vector<ValueId> held_by;
  /// Of each value: outputs of the net, and what is to be kept. Nothing may write over these.
  std::vector<bool> read_outside;
  std::optional<ValueId> gray_input;  // has one channel in memory, which stands for all
};

/// One operation a layer, nothing merged; layers that change nothing (Dropout, Split) are gone.
/// `shapes` are those of the net's values; `kept` are read from outside beside the net's outputs.
Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes,
                         const std::vector<ValueId>& kept = {});

}  // namespace revisit::engine
