#include <algorithm>

#include "net_impl.h"

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

}  // namespace

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes) {
  std::vector<Shape> result;
  for (const ValueId id : ids) result.push_back(shapes[id]);
  return result;
}

void rethrow_at(const std::string& file, const Node& node) {
  const std::string place = str(file, ": layer '", node.name, "' (", node.param.type(), "): ");
  try {
    throw;
  } catch (const UnsupportedError& error) {
    throw UnsupportedError(place, error);
  } catch (const InputError& error) {
    throw InputError(place, error);
  }
}

std::vector<Shape> infer_shapes(const Net::Impl& net, const std::map<std::string, Shape>& inputs) {
  std::vector<Shape> shapes(net.graph.values.size());
  std::vector<std::string> input_names;
  for (const Node& node : net.graph.nodes) {
    try {
      if (!node.layer) {
        expect_count(node.inputs.size(), 0, "bottoms");
        for (size_t port = 0; port < node.outputs.size(); ++port) {
          const std::string& blob = net.graph.values[node.outputs[port]].blob;
          const auto given = inputs.find(blob);
          shapes[node.outputs[port]] =
              given != inputs.end() ? given->second : input_shape(node, port);
          input_names.push_back(blob);
        }
        continue;
      }
      const std::vector<Shape> outputs =
          node.layer->infer(shapes_of(node.inputs, shapes), node.outputs.size());
      expect_count(node.outputs.size(), outputs.size(), "outputs");
      for (size_t port = 0; port < outputs.size(); ++port)
        shapes[node.outputs[port]] = outputs[port];
    } catch (const Error&) {
      rethrow_at(net.file, node);
    }
  }
  for (const auto& [blob, shape] : inputs)
    if (std::find(input_names.begin(), input_names.end(), blob) == input_names.end())
      throw UsageError(net.file, ": the (possibly truncated) net has no input '", blob, "'",
                       nearest_name_hint(blob, input_names));
  return shapes;
}

}  // namespace revisit::engine
