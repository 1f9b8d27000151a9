#include "dynamic_rows.h"

namespace revisit::engine {
namespace {

/// The rows of `input` seen through a view: the axis of the output that grows with them.
DynamicRows through_view(const Layer& view, size_t n_outputs, size_t port,
                         std::vector<Shape> inputs, const DynamicRows& rows) {
  const auto infer = [&](int64_t n_rows) {
    inputs[0] = inputs[0].with(rows.axis, rows.multiple * n_rows);
    return view.infer(inputs, n_outputs)[port];
  };
  std::optional<DynamicRows> found;
  try {
    const Shape one = infer(1), two = infer(2);
    for (size_t axis = 0; axis < one.rank(); ++axis)
      if (two[axis] == 2 * one[axis]) found = DynamicRows{rows.layer, axis, one[axis]};
  } catch (const InputError&) {
    found.reset();  // a shape that holds for one number of rows only
  }
  if (!found)
    throw UnsupportedError(
        "the number of rows of its input depends on the data, and this shape does not follow it");
  return *found;
}

}  // namespace

std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes) {
  std::vector<std::optional<DynamicRows>> result(net.graph.values.size());
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (!node.layer) continue;
    const Layer& layer = *node.layer;
    try {
      const bool is_view = layer.output_memory() == OutputMemory::kViewOfInput;
      std::vector<Shape> inputs;
      for (size_t port = 0; port < node.inputs.size(); ++port) {
        const ValueId id = node.inputs[port];
        inputs.push_back(shapes[id]);
        if (result[id] && !is_view)
          throw UnsupportedError("the number of rows of its input '", net.graph.values[id].blob,
                                 "' depends on the data (layer '",
                                 net.graph.nodes[result[id]->layer].name,
                                 "'); such a blob can only be an output: end the net "
                                 "before this layer (",
                                 CppName{"Truncation::end"}, ")");
      }
      for (size_t port = 0; port < node.outputs.size(); ++port) {
        std::optional<DynamicRows>& rows = result[node.outputs[port]];
        if (const auto axis = layer.dynamic_axis())
          rows = DynamicRows{i, *axis, 1};
        else if (is_view && result[node.inputs[0]])
          rows = through_view(layer, node.outputs.size(), port, inputs, *result[node.inputs[0]]);
      }
    } catch (const Error&) {
      rethrow_at(net.file, node);
    }
  }
  return result;
}

}  // namespace revisit::engine
