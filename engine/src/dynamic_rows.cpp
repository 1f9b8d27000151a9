#include <algorithm>

#include "plan_impl.h"

namespace revisit::engine {
namespace {

using Rows = std::vector<std::optional<DynamicRows>>;

DynamicRows through_layer(const Layer& layer, size_t n_outputs, size_t port,
                          std::vector<Shape> inputs, const Rows& rows) {
  const auto infer = [&](int64_t n_rows) {
    for (size_t i = 0; i < inputs.size(); ++i)
      if (rows[i]) inputs[i] = inputs[i].with(rows[i]->axis, rows[i]->multiple * n_rows);
    return layer.infer(inputs, n_outputs)[port];
  };
  const auto first =
      std::ranges::find_if(rows, [](const auto& input) { return input.has_value(); });
  std::optional<DynamicRows> found;
  try {
    const Shape one = infer(1), two = infer(2);
    for (size_t axis = 0; axis < one.rank(); ++axis)
      if (two[axis] == 2 * one[axis]) found = DynamicRows{(*first)->layer, axis, one[axis]};
  } catch (const InputError&) {
    found.reset();  // the shape is valid for one number of rows only
  }
  if (!found)
    throw UnsupportedError(
        "the number of rows of its input depends on the data, but the shape of its output does not "
        "scale with it");
  return *found;
}

bool keeps_rows(const Layer& layer, const std::vector<Shape>& inputs, const Rows& rows) {
  std::optional<size_t> counting;
  for (size_t port = 0; port < rows.size(); ++port) {
    if (!rows[port]) continue;
    if (rows[port]->axis != 0 || !layer.keeps_items(port, inputs) ||
        counting.value_or(rows[port]->layer) != rows[port]->layer)
      return false;
    counting = rows[port]->layer;
  }
  return true;
}

}  // namespace

std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes) {
  Rows result(net.graph.values.size());
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (!node.layer) continue;
    const Layer& layer = *node.layer;
    try {
      std::vector<Shape> inputs;
      Rows rows;
      for (const ValueId id : node.inputs) {
        inputs.push_back(shapes[id]);
        rows.push_back(result[id]);
      }
      const auto first =
          std::ranges::find_if(rows, [](const auto& input) { return input.has_value(); });
      if (first != rows.end() && layer.output_memory() != OutputMemory::kViewOfInput &&
          (layer.dynamic_axis() || !keeps_rows(layer, inputs, rows)))
        throw UnsupportedError(
            "the number of rows of its input '",
            net.graph.values[node.inputs[first - rows.begin()]].blob,
            "' depends on the data (layer '", net.graph.nodes[(*first)->layer].name,
            "'), but it does not compute each row independently; end the net before "
            "this layer");
      for (size_t port = 0; port < node.outputs.size(); ++port) {
        std::optional<DynamicRows>& output = result[node.outputs[port]];
        if (const auto axis = layer.dynamic_axis())
          output = DynamicRows{i, *axis, 1};
        else if (first != rows.end())
          output = through_layer(layer, node.outputs.size(), port, inputs, rows);
      }
    } catch (const Error&) {
      rethrow_at(net.file, node);
    }
  }
  return result;
}

Kernel with_zero_rest(Kernel kernel, const std::vector<Shape>& outputs) {
  kernel.run = [run = std::move(kernel.run), outputs](const Call& call) {
    run(call);
    for (size_t i = 0; i < outputs.size(); ++i)
      std::fill(call.outputs[i] + *call.rows * outputs[i].product(1, outputs[i].rank()),
                call.outputs[i] + outputs[i].elements(), 0.0F);
  };
  return kernel;
}

}  // namespace revisit::engine
