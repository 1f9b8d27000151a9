#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "kernels/blocked/kernels.h"
#include "net_impl.h"

namespace revisit::engine {

/// A unit of execution: a layer with the layers fused into it.
struct Operation {
  size_t node;                   // main layer: index into Graph::nodes
  std::vector<size_t> absorbed;  // fused layers
  std::reference_wrapper<const Layer> layer;
  Form form;
  std::vector<ValueId> inputs, outputs;
  Fusion fusion = {};
  int max_winograd_points = kAnyPoints;
  /// Kernel of a convolution, set if a fusion requires it; null: chosen at scheduling.
  const BlockedConvolutionKernel* convolution = nullptr;
};

/// Layers of a net as operations, in execution order, without Input layers.
struct Operations {
  std::vector<Operation> list;
  /// Per value: the value that stores its numbers, which is itself unless its layer is an identity.
  std::vector<ValueId> held_by;
  /// Per value: true for outputs of the net and kept values, which must not be overwritten.
  std::vector<bool> read_outside;
  std::optional<ValueId> gray_input;  // input with a single channel in memory that represents all
};

/// Makes one operation per layer, without fusion; drops identities (Dropout, Split). `shapes` are
/// those of all values; `kept` values are read from outside in addition to the net's outputs.
Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes,
                         const std::vector<ValueId>& kept = {});

}  // namespace revisit::engine
