#pragma once

#include <vector>

#include "graph.h"
#include "layer.h"
#include "receptive_field.h"

namespace revisit::engine {

/// Follows receptive fields and producers through the graph, node by node.
class Tracer {
 public:
  explicit Tracer(const Graph& graph);

  /// Sets `input_layers` and the fields of `cost`, which has its shapes. `layer` is null for Input.
  void trace(size_t index, const Layer* layer, LayerCost* cost);

 private:
  struct Fields {
    Field h, w;
  };
  const Graph& graph_;
  std::vector<Fields> fields_;    // of each value
  std::vector<size_t> producer_;  // node of each value
};

}  // namespace revisit::engine
