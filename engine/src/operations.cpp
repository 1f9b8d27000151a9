#include "operations.h"

#include <algorithm>
#include <numeric>

namespace revisit::engine {
namespace {

bool changes_nothing(const Node& node, const std::vector<Shape>& shapes) {
  return node.layer->output_memory() == OutputMemory::kViewOfInput &&
         std::all_of(node.outputs.begin(), node.outputs.end(),
                     [&](ValueId id) { return shapes[id] == shapes[node.inputs[0]]; });
}

}  // namespace

Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes,
                         const std::vector<ValueId>& kept) {
  Operations operations;
  std::vector<ValueId>& held_by = operations.held_by;
  held_by.resize(net.graph.values.size());
  std::iota(held_by.begin(), held_by.end(), 0);
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (!node.layer) continue;
    if (changes_nothing(node, shapes)) {
      for (const ValueId id : node.outputs) held_by[id] = held_by[node.inputs[0]];
      continue;
    }
    Operation operation{
        i,           {},
        *node.layer, node.layer->form(shapes_of(node.inputs, shapes), *node.weights),
        node.inputs, node.outputs};
    if (operation.layer.get().output_memory() == OutputMemory::kViewOfInput)
      operation.inputs.resize(1);  // further inputs only define the shape
    for (ValueId& id : operation.inputs) id = held_by[id];
    operations.list.push_back(std::move(operation));
  }
  operations.read_outside.resize(held_by.size(), false);
  for (const ValueId id : kept) operations.read_outside[held_by[id]] = true;
  for (const Graph::Output& output : net.graph.outputs)
    operations.read_outside[held_by[output.value]] = true;
  return operations;
}

}  // namespace revisit::engine
