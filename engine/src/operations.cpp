#include "operations.h"

#include <numeric>

namespace revisit::engine {

Operations operations_of(const Net::Impl& net) {
  Operations operations;
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (net.nodes[i].layer)
      operations.list.push_back({i, {}, net.nodes[i].layer, node.inputs, node.outputs, {}});
  }
  operations.held_by.resize(net.graph.values.size());
  std::iota(operations.held_by.begin(), operations.held_by.end(), 0);
  return operations;
}

}  // namespace revisit::engine
