#include <algorithm>
#include <limits>

#include "plan_impl.h"

namespace revisit::engine {
namespace {

Shape input_shape(const Node& node, size_t port) {
  const caffe::InputParameter& param = node.param.input_param();
  const auto n_shapes = static_cast<size_t>(param.shape_size());
  if (n_shapes == 0)
    throw InputError("the file gives no shape for the input '",
                     node.param.top(static_cast<int>(port)),
                     "'; give it in the prototxt or by an input shape");
  if (n_shapes != 1 && n_shapes != node.outputs.size())
    throw InputError("expected 1 or ", node.outputs.size(), " shapes, found ", n_shapes,
                     "; give them in the prototxt or by an input shape");
  const caffe::BlobShape& shape = param.shape(n_shapes == 1 ? 0 : static_cast<int>(port));
  return Shape(std::vector<int64_t>(shape.dim().begin(), shape.dim().end()));
}

using Rows = std::vector<std::optional<DynamicRows>>;

DynamicRows through_layer(const Layer& layer, size_t n_outputs, size_t port,
                          std::vector<Shape> inputs, const Rows& rows, size_t counting_layer) {
  const auto infer = [&](int64_t n_rows) {
    for (size_t i = 0; i < inputs.size(); ++i)
      if (rows[i]) inputs[i] = inputs[i].with(rows[i]->axis, rows[i]->multiple * n_rows);
    return layer.infer(inputs, n_outputs)[port];
  };
  std::optional<DynamicRows> found;
  try {
    const Shape one = infer(1), two = infer(2);
    for (size_t axis = 0; axis < one.rank(); ++axis)
      if (two[axis] == 2 * one[axis]) found = DynamicRows{counting_layer, axis, one[axis]};
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

std::vector<Shape> OneToOneLayer::infer(const std::vector<Shape>& inputs, size_t n_outputs) const {
  expect_count(inputs.size(), 1, "inputs");
  expect_count(n_outputs, 1, "outputs");
  return {output_shape(inputs[0])};
}

bool is_for_training(const caffe::LayerParameter& param) {
  return param.has_phase() && param.phase() == caffe::TRAIN;
}

void expect_count(size_t found, size_t expected, const char* what) {
  if (found != expected) throw InputError("expected ", expected, " ", what, ", found ", found);
}

void expect_1_or_2(size_t found, const char* what) {
  if (found < 1 || found > 2) throw InputError("expected 1 or 2 ", what, ", found ", found);
}

void expect_any(size_t found, const char* what) {
  if (found == 0) throw InputError("expected at least one ", what);
}

void expect_image(const Shape& input, const char* what) {
  if (input.rank() != 4)
    throw InputError(what, " needs an input of 4 axes (n x c x h x w), found ", input);
}

void expect_channels(const Shape& input, const char* what) {
  if (input.rank() < 2) throw InputError(what, " needs an input of at least 2 axes, found ", input);
}

void expect_int(int64_t size, const char* what) {
  constexpr int64_t kMost = std::numeric_limits<int>::max();
  if (size > kMost) throw InputError(what, " must be at most ", kMost, ", found ", size);
}

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes) {
  std::vector<Shape> result;
  for (const ValueId id : ids) result.push_back(shapes[id]);
  return result;
}

std::string place_of(const std::string& file, const Node& node) {
  return str(file, ": layer '", node.name, "' (", node.param.type(), ")");
}

void at_layer(const std::string& file, const Node& node, const std::function<void()>& work) {
  try {
    work();
  } catch (const UnsupportedError& error) {
    throw UnsupportedError(place_of(file, node), ": ", error);
  } catch (const InputError& error) {
    throw InputError(place_of(file, node), ": ", error);
  }
}

std::vector<Shape> infer_shapes(const Net::Impl& net, const std::map<std::string, Shape>& inputs) {
  std::vector<Shape> shapes(net.graph.values.size());
  std::vector<std::string> input_names;
  for (const Node& node : net.graph.nodes)
    at_layer(net.file, node, [&] {
      if (!node.layer) {
        expect_count(node.inputs.size(), 0, "bottoms");
        for (size_t port = 0; port < node.outputs.size(); ++port) {
          const std::string& blob = net.graph.values[node.outputs[port]].blob;
          const auto given = inputs.find(blob);
          shapes[node.outputs[port]] =
              given != inputs.end() ? given->second : input_shape(node, port);
          input_names.push_back(blob);
        }
        return;
      }
      const std::vector<Shape> outputs =
          node.layer->infer(shapes_of(node.inputs, shapes), node.outputs.size());
      expect_count(node.outputs.size(), outputs.size(), "outputs");
      for (size_t port = 0; port < outputs.size(); ++port)
        shapes[node.outputs[port]] = outputs[port];
    });
  for (const auto& [blob, shape] : inputs)
    if (std::find(input_names.begin(), input_names.end(), blob) == input_names.end())
      throw UsageError(net.file, ": the (possibly truncated) net has no input '", blob, "'",
                       nearest_name_hint(blob, input_names));
  return shapes;
}

std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes) {
  Rows result(net.graph.values.size());
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    const Node& node = net.graph.nodes[i];
    if (!node.layer) continue;
    const Layer& layer = *node.layer;
    at_layer(net.file, node, [&] {
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
            "'), but it does not compute each row independently; end the net before this layer");
      for (size_t port = 0; port < node.outputs.size(); ++port) {
        std::optional<DynamicRows>& output = result[node.outputs[port]];
        if (const auto axis = layer.dynamic_axis())
          output = DynamicRows{i, *axis, 1};
        else if (first != rows.end())
          output = through_layer(layer, node.outputs.size(), port, inputs, rows, (*first)->layer);
      }
    });
  }
  return result;
}

}  // namespace revisit::engine
