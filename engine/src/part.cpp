#include <algorithm>
#include <limits>
#include <set>

#include "layers/layers.h"
#include "schedule.h"

namespace revisit::engine {
namespace {

/// Returns the index of a layer in Graph::nodes.
size_t index_of(const Net::Impl& net, std::string_view name) {
  const std::vector<Node>& nodes = net.graph.nodes;
  const auto found = std::ranges::find(nodes, name, [](const Node& node) { return node.name; });
  if (found != nodes.end()) return static_cast<size_t>(found - nodes.begin());
  throw UsageError("part: the (possibly truncated) net '", net.graph.name, "' has no layer '", name,
                   "'", nearest_name_hint(name, net.layer_names));
}

/// Adds an Input of the values that the nodes of `part` read and none of them writes.
void add_boundary(Graph* part) {
  Node boundary;
  boundary.type = kInputType;
  boundary.name = "earlier layers";
  boundary.param.set_type(boundary.type);
  std::set<ValueId> known;
  for (const Node& node : part->nodes) {
    for (const ValueId id : node.inputs)
      if (known.insert(id).second) boundary.outputs.push_back(id);
    known.insert(node.outputs.begin(), node.outputs.end());
  }
  if (!boundary.outputs.empty()) part->nodes.insert(part->nodes.begin(), std::move(boundary));
}

/// The last value of every blob that a layer of the part computes.
std::vector<std::pair<std::string, ValueId>> last_values(const Graph& part) {
  std::vector<std::pair<std::string, ValueId>> outputs;
  for (const Node& node : part.nodes) {
    if (!node.layer) continue;
    for (const ValueId id : node.outputs) {
      const std::string& blob = part.values[id].blob;
      std::erase_if(outputs, [&](const auto& output) { return output.first == blob; });
      outputs.push_back({blob, id});
    }
  }
  return outputs;
}

/// Keeps the nodes that the outputs of `graph` need, and all inputs.
void keep_needed(Graph* graph) {
  std::vector<bool> needed(graph->values.size(), false);
  for (const auto& [name, id] : graph->outputs) needed[id] = true;
  std::vector<Node> kept;
  for (size_t i = graph->nodes.size(); i-- > 0;) {
    Node& node = graph->nodes[i];
    if (node.layer && std::ranges::none_of(node.outputs, [&](ValueId id) { return needed[id]; }))
      continue;
    for (const ValueId id : node.inputs) needed[id] = true;
    kept.push_back(std::move(node));
  }
  std::ranges::reverse(kept);
  graph->nodes = std::move(kept);
}

/// Returns the value of a layer by proto::port_name().
ValueId value_of(const Net::Impl& net, const std::string& port) {
  for (const Node& node : net.graph.nodes)
    for (size_t i = 0; i < node.outputs.size(); ++i)
      if (proto::port_name(node.name, i) == port) return node.outputs[i];
  throw UsageError("truncated: the net '", net.graph.name, "' has no layer '", port,
                   "' with an output", nearest_name_hint(port, net.layer_names));
}

/// The values that the layers before `node` store by channel blocks. A part that reads them so,
/// too, has the kernels of the whole net, and its bits.
std::set<ValueId> blocked_before(const Net::Impl& net, const std::vector<Shape>& shapes,
                                 size_t node) {
  const auto begin = net.graph.nodes.begin(), end = begin + static_cast<std::ptrdiff_t>(node);
  if (std::none_of(begin, end, [](const Node& before) { return before.layer != nullptr; }))
    return {};
  Operations operations = operations_of(net, shapes);
  limit_rounding(false, net.sensitive, &operations);
  const PlanOptions options{.max_run_bytes = std::numeric_limits<int64_t>::max()};
  const Schedule whole = schedule(net, shapes, operations, options, true);
  std::set<ValueId> stored, blocked;
  for (const Step& step : whole.steps)
    for (const size_t output : step.outputs)
      if (step.layer < node && whole.stored[output].layout == Layout::kNChw16c)
        stored.insert(whole.stored[output].value);
  for (size_t id = 0; id < operations.held_by.size(); ++id)
    if (stored.contains(operations.held_by[id])) blocked.insert(static_cast<ValueId>(id));
  return blocked;
}

std::shared_ptr<Net::Impl> without_graph(const Net::Impl& net) {
  auto part = std::make_shared<Net::Impl>();
  part->file = net.file;
  part->layer_names = net.layer_names;
  part->has_weights = net.has_weights;
  return part;
}

}  // namespace

Net Net::truncated(const std::vector<std::string>& layers) const {
  if (layers.empty()) throw UsageError("truncated: expected at least one layer, found none");
  const std::shared_ptr<Impl> part = without_graph(*impl_);
  part->graph = impl_->graph;
  part->graph.outputs.clear();
  for (const std::string& port : std::set(layers.begin(), layers.end()))
    part->graph.outputs.push_back({port, value_of(*impl_, port)});
  keep_needed(&part->graph);
  part->sensitive = sensitive_values(part->graph);
  part->inputs = impl_->inputs;
  part->blocked_inputs = impl_->blocked_inputs;
  return Net(part);
}

Net Net::part(std::string_view first, std::string_view last) const {
  const Graph& whole = impl_->graph;
  size_t begin = index_of(*impl_, first), end = index_of(*impl_, last) + 1;
  if (begin >= end)
    throw UsageError("part: the layer '", first, "' comes after the layer '", last, "'");
  // With inserted nodes, because their blobs have changed in memory that they share.
  while (begin > 0 && whole.nodes[begin - 1].index < 0) --begin;
  while (end < whole.nodes.size() && whole.nodes[end].index < 0) ++end;
  const std::shared_ptr<Impl> part = without_graph(*impl_);
  part->sensitive = impl_->sensitive;
  part->graph = {whole.name, {}, whole.values, {}};
  part->graph.nodes.assign(whole.nodes.begin() + static_cast<std::ptrdiff_t>(begin),
                           whole.nodes.begin() + static_cast<std::ptrdiff_t>(end));
  add_boundary(&part->graph);
  part->graph.outputs = last_values(part->graph);

  std::map<std::string, Shape> given;
  for (const Port& input : impl_->inputs) given.emplace(input.name, input.shape);
  const std::vector<Shape> shapes = infer_shapes(*impl_, given);
  part->blocked_inputs = blocked_before(*impl_, shapes, begin);
  for (const Node& node : part->graph.nodes)
    if (!node.layer)
      for (const ValueId id : node.outputs)
        part->inputs.push_back({whole.values[id].blob, shapes[id]});
  return Net(part);
}

}  // namespace revisit::engine
