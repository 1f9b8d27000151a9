#include "operations.h"

#include <algorithm>
#include <numeric>

namespace revisit::engine {
namespace {

bool changes_nothing(const Layer& layer, const Node& node, const std::vector<Shape>& shapes) {
  return layer.output_memory() == OutputMemory::kViewOfInput &&
         std::all_of(node.outputs.begin(), node.outputs.end(),
                     [&](ValueId id) { return shapes[id] == shapes[node.inputs[0]]; });
}

}  // namespace

Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes) {
  Operations operations;
  std::vector<ValueId>& held_by = operations.held_by;
  held_by.resize(net.graph.values.size());
  std::iota(held_by.begin(), held_by.end(), 0);
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    const std::shared_ptr<const Layer>& layer = net.nodes[i].layer;
    if (!layer) continue;
    if (changes_nothing(*layer, node, shapes)) {
      for (const ValueId id : node.outputs) held_by[id] = held_by[node.inputs[0]];
      continue;
    }
    std::vector<Shape> inputs;
    for (const ValueId id : node.inputs) inputs.push_back(shapes[id]);
    Operation operation{i,           {},          layer, layer->form(inputs, net.nodes[i].weights),
                        node.inputs, node.outputs};
    for (ValueId& id : operation.inputs) id = held_by[id];
    operations.list.push_back(std::move(operation));
  }
  return operations;
}

}  // namespace revisit::engine
