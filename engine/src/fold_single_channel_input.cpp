#include <algorithm>

#include "operations.h"

namespace revisit::engine {
namespace {

bool supports_single_channel(const Operation& operation) {
  const auto* convolving = std::get_if<Convolving>(&operation.form);
  return convolving && convolving->problem.group == 1 && operation.inputs.size() == 1;
}

std::string single_channel_obstacle(const Net::Impl& net, const Operations& operations, ValueId id,
                                    const Shape& shape) {
  if (shape.rank() != 4) return str("the input must be n x c x h x w, found ", shape);
  for (const auto& [name, value] : net.graph.outputs)
    if (operations.held_by[value] == id) return str("the output '", name, "' is the input itself");
  for (const Operation& operation : operations.list) {
    if (std::count(operation.inputs.begin(), operation.inputs.end(), id) == 0 ||
        supports_single_channel(operation))
      continue;
    const Node& node = net.graph.nodes[operation.node];
    return str("layer '", node.name, "' (", node.param.type(),
               ") reads the input; only convolutions without groups support a single channel");
  }
  return "";
}

ValueId only_input(const Net::Impl& net) {
  return std::ranges::find_if(net.graph.nodes, [](const Node& node) { return !node.layer; })
      ->outputs[0];
}

}  // namespace

void fold_single_channel_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                               const std::vector<float>& offsets, Operations* operations) {
  if (net.inputs.size() != 1)
    throw UsageError("single-channel input: expected a net with one input, found ",
                     net.inputs.size());
  const ValueId id = only_input(net);
  const Shape& shape = shapes[id];
  const std::string reason = single_channel_obstacle(net, *operations, id, shape);
  if (!reason.empty()) throw UsageError("single-channel input: " + reason);
  if (shape[1] != static_cast<int64_t>(offsets.size()))
    throw UsageError("single-channel input: expected an offset for each of the ", shape[1],
                     " channels of the input, found ", offsets.size());
  for (Operation& operation : operations->list)
    if (std::count(operation.inputs.begin(), operation.inputs.end(), id) > 0)
      operation.fusion.channel_offsets = offsets;
  operations->gray_input = id;
}

bool Net::takes_single_channel_input() const {
  if (impl_->inputs.size() != 1) return false;
  const std::vector<Shape> shapes =
      infer_shapes(*impl_, {{impl_->inputs[0].name, impl_->inputs[0].shape}});
  const ValueId id = only_input(*impl_);
  return single_channel_obstacle(*impl_, operations_of(*impl_, shapes), id, shapes[id]).empty();
}

}  // namespace revisit::engine
