#include "graph.h"

#include <algorithm>
#include <map>

namespace revisit::engine {
namespace {

constexpr CppName kEnd{"Truncation::end"}, kGraft{"Truncation::graft"};

/// Resolves blob names to values while nodes are added in order.
class Builder {
 public:
  explicit Builder(Graph& graph) : graph_(graph) {}

  void add(const caffe::LayerParameter& layer) {
    Node node{layer.name(), layer, {}, {}};
    node.index = static_cast<int>(graph_.nodes.size());
    node.param.clear_blobs();
    for (const std::string& bottom : layer.bottom()) {
      node.inputs.push_back(consume(bottom));
      if (node.inputs.back() < 0) node.dangling = bottom;
    }
    for (int i = 0; i < layer.top_size(); ++i) {
      const std::string& top = layer.top(i);
      const bool in_place = i < layer.bottom_size() && layer.bottom(i) == top;
      node.in_place |= in_place;
      if (!in_place && current_.count(top)) node.overwritten = top;
      node.outputs.push_back(produce(top));
    }
    graph_.nodes.push_back(std::move(node));
  }

  /// The values nobody consumed are the outputs of the net.
  void finish() {
    for (ValueId id = 0; id < static_cast<ValueId>(graph_.values.size()); ++id)
      if (!consumed_[id]) graph_.outputs.push_back({graph_.values[id].blob, id});
  }

 private:
  ValueId consume(const std::string& bottom) {
    const auto found = current_.find(bottom);
    if (found == current_.end()) return -1;
    consumed_[found->second] = true;
    return found->second;
  }

  ValueId produce(const std::string& top) {
    const auto id = static_cast<ValueId>(graph_.values.size());
    graph_.values.push_back({top});
    consumed_.push_back(false);
    current_[top] = id;
    return id;
  }

  Graph& graph_;
  std::map<std::string, ValueId> current_;  // the value a blob name means now
  std::vector<bool> consumed_;
};

void check_names(const Graph& whole, const Node& node) {
  if (!node.overwritten.empty())
    throw InputError("layer '", node.name, "': top '", node.overwritten,
                     "' is already written by another layer and is not its own bottom");
  if (node.dangling.empty()) return;
  std::vector<std::string> known;
  for (int i = 0; i < node.index; ++i)
    known.insert(known.end(), whole.nodes[i].param.top().begin(), whole.nodes[i].param.top().end());
  throw InputError("layer '", node.name, "': bottom '", node.dangling,
                   "' is written by no layer before it", did_you_mean(node.dangling, known));
}

const Node& find_layer(const Graph& graph, const std::string& name, CppName option) {
  std::vector<std::string> others;
  for (const Node& node : graph.nodes) {
    if (node.name == name) return node;
    others.push_back(node.name);
  }
  throw UsageError(option, ": the net '", graph.name, "' has no layer '", name, "'",
                   did_you_mean(name, others), "; ", CppName{"Net::layer_names"}, " lists them");
}

/// Output of the ReLU of `value` that works in place or is its only reader; else `value` itself.
ValueId after_relu(Graph& graph, const Truncation& truncation, ValueId value) {
  const Node* relu = nullptr;
  int n_readers = 0;
  for (const Node& node : graph.nodes) {
    if (std::ranges::find(node.inputs, value) == node.inputs.end()) continue;
    ++n_readers;
    if (node.param.type() == "ReLU" && (!relu || node.in_place)) relu = &node;
  }
  if (!relu) return value;
  if (relu->in_place || n_readers == 1) return relu->outputs.at(0);
  graph.warnings.push_back(str("'", truncation.name(), "' is grafted onto '", truncation.end,
                               "' before the ReLU '", relu->name,
                               "', because other layers read it, too; end the net at '", relu->name,
                               "' to graft after it"));
  return value;
}

/// Appends a copy of layer `graft` (parameters only) after `end` and its ReLU.
Graph::Output append_graft(Graph& graph, const Truncation& truncation, ValueId value) {
  const Node& source = find_layer(graph, truncation.graft, kGraft);
  if (source.inputs.size() != 1 || source.outputs.size() != 1)
    throw UsageError(kGraft, ": layer '", truncation.graft,
                     "' must have one input and one output to be grafted");
  value = after_relu(graph, truncation, value);
  Node node = source;
  node.name = truncation.name();
  node.in_place = false;
  node.dangling = node.overwritten = "";
  node.inputs = {value};
  node.outputs = {static_cast<ValueId>(graph.values.size())};
  graph.values.push_back({node.name});
  graph.nodes.push_back(std::move(node));
  return {truncation.name(), graph.nodes.back().outputs[0]};
}

}  // namespace

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes) {
  std::vector<Shape> result;
  for (const ValueId id : ids) result.push_back(shapes[id]);
  return result;
}

Graph parse(const caffe::NetParameter& net) {
  Graph graph;
  graph.name = net.name();
  Builder builder(graph);
  for (const caffe::LayerParameter& layer : net.layer()) builder.add(layer);
  builder.finish();
  return graph;
}

Graph prune(const Graph& whole, const Truncation& truncation) {
  Graph graph = whole;
  if (!truncation.graft.empty() && truncation.end.empty())
    throw UsageError(kGraft, " needs ", kEnd, ": the layer to graft onto");
  if (!truncation.end.empty()) {
    const Node& end = find_layer(graph, truncation.end, kEnd);
    if (end.outputs.empty()) throw UsageError(kEnd, ": layer '", end.name, "' has no output");
    if (!truncation.graft.empty() && end.outputs.size() > 1)
      throw UsageError(kGraft, ": the layer '", end.name, "' (", kEnd, ") has ", end.outputs.size(),
                       " outputs; graft onto a layer with one");
    if (truncation.graft.empty()) {
      graph.outputs.clear();
      for (size_t i = 0; i < end.outputs.size(); ++i)
        graph.outputs.push_back({port_name(end.name, i), end.outputs[i]});
    } else {
      graph.outputs = {append_graft(graph, truncation, end.outputs[0])};
    }
  }

  std::vector<bool> needed(graph.values.size(), false);
  for (const Graph::Output& output : graph.outputs) needed[output.value] = true;
  std::vector<Node> kept;
  for (size_t i = graph.nodes.size(); i-- > 0;) {
    Node& node = graph.nodes[i];
    // Silence is a use without an output: what it takes stays an input of the whole net.
    const bool silences = truncation.end.empty() && node.param.type() == "Silence";
    if (!silences && std::none_of(node.outputs.begin(), node.outputs.end(),
                                  [&](ValueId id) { return needed[id]; }))
      continue;
    for (const ValueId input : node.inputs)
      if (input >= 0) needed[input] = true;
    kept.push_back(std::move(node));
  }
  std::reverse(kept.begin(), kept.end());
  for (const Node& node : truncation.end.empty() ? whole.nodes : kept) check_names(whole, node);
  graph.nodes = std::move(kept);
  return graph;
}

std::string port_name(const std::string& layer, size_t port) {
  return port == 0 ? layer : layer + "." + std::to_string(port);
}

}  // namespace revisit::engine
