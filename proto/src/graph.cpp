#include <algorithm>
#include <map>
#include <optional>
#include <set>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/proto/net_file.h"

namespace revisit::proto {
namespace {

constexpr const char *kEnd = "end", *kGraft = "graft";

/// Shows `source`, written by in-place `layer`, in the shape of `id`, which shares its memory.
ValueId append_present(Graph& graph, ValueId source, const std::string& layer, ValueId id) {
  const Value value = graph.values[id];
  const auto present = static_cast<ValueId>(graph.values.size());
  graph.nodes.push_back({value.blob + " after " + layer, "Split", -1, {source, id}, {present}});
  graph.values.push_back(value);
  return present;
}

class Builder {
 public:
  explicit Builder(Graph& graph) : graph_(graph) {}

  void add(const caffe::LayerParameter& layer) {
    Node node{layer.name(), layer.type(), layers_++, {}, {}};
    // A layer that only prints or stores does not run, so the net still outputs what it reads.
    const bool consumes = layer.top_size() > 0 || layer.type() == "Silence";
    for (const std::string& bottom : layer.bottom()) {
      node.inputs.push_back(consume(bottom, consumes));
      if (node.inputs.back() < 0) node.dangling = bottom;
    }
    const bool shares = shares_memory(layer) && !node.inputs.empty() && node.inputs[0] >= 0;
    for (int i = 0; i < layer.top_size(); ++i) {
      const std::string& top = layer.top(i);
      const bool in_place = i < layer.bottom_size() && layer.bottom(i) == top;
      node.in_place |= in_place;
      if (!in_place && current_.count(top)) node.overwritten = top;
      const ValueId id = produce(top);
      node.outputs.push_back(id);
      if (in_place && node.inputs[i] >= 0) {
        graph_.values[id].memory = graph_.values[node.inputs[i]].memory;
        latest_[graph_.values[id].memory] = {id, layer.name()};
      } else if (shares) {
        graph_.values[id].memory = graph_.values[node.inputs[0]].memory;
        content_[id] = content_[node.inputs[0]];
      }
    }
    graph_.nodes.push_back(std::move(node));
  }

  void finish() {
    for (auto& [blob, id] : current_)
      if (!consumed_[id]) id = up_to_date(id);
    for (ValueId id = 0; id < static_cast<ValueId>(graph_.values.size()); ++id)
      if (!consumed_[id]) graph_.outputs.push_back({graph_.values[id].blob, id});
  }

 private:
  struct WrittenInPlace {
    ValueId value;
    std::string layer;
  };

  ValueId consume(const std::string& bottom, bool consumes) {
    const auto found = current_.find(bottom);
    if (found == current_.end()) return -1;
    found->second = up_to_date(found->second);
    if (consumes) consumed_[found->second] = true;
    return found->second;
  }

  ValueId produce(const std::string& top) {
    const auto id = static_cast<ValueId>(graph_.values.size());
    graph_.values.push_back({top, id});
    consumed_.push_back(false);
    content_.push_back(id);
    current_[top] = id;
    return id;
  }

  /// Returns the current value of a blob with the value `id`. If a layer worked in place on another
  /// blob in the same memory since, it is that layer's result in the shape of `id`.
  ValueId up_to_date(ValueId id) {
    const ValueId memory = graph_.values[id].memory;
    const auto written = latest_.find(memory);
    if (written == latest_.end() || content_[id] == content_[written->second.value]) return id;
    const auto& [source, layer] = written->second;
    const ValueId result = append_present(graph_, source, layer, id);
    content_.push_back(source);
    consumed_.push_back(consumed_[id]);
    consumed_[id] = true;
    return result;
  }

  Graph& graph_;
  std::map<std::string, ValueId> current_;
  int layers_ = 0;
  std::vector<bool> consumed_;
  std::vector<ValueId> content_;              // per value: the value whose numbers it has
  std::map<ValueId, WrittenInPlace> latest_;  // last in-place result per memory
};

void check_names(const Graph& whole, const Node& node) {
  if (!node.overwritten.empty())
    throw InputError("layer '", node.name, "': top '", node.overwritten,
                     "' is already written by another layer and is not its own bottom");
  if (node.dangling.empty()) return;
  std::vector<std::string> known;
  for (const Node& before : whole.nodes)
    if (before.index < node.index)
      for (const ValueId id : before.outputs) known.push_back(whole.values[id].blob);
  const auto dropped = whole.dropped.find(node.dangling);
  throw InputError("layer '", node.name, "': bottom '", node.dangling,
                   "' is not written by an earlier layer",
                   dropped == whole.dropped.end() ? nearest_name_hint(node.dangling, known)
                                                  : "; " + dropped->second);
}

/// "'crop' (Crop), which writes 'upscore'".
std::string description_of(const Graph& graph, const Node& node) {
  std::string text = str("'", node.name, "' (", node.type, ")");
  for (size_t i = 0; i < node.outputs.size(); ++i)
    text += str(i == 0 ? ", which writes '" : ", '", graph.values[node.outputs[i]].blob, "'");
  return text;
}

/// Returns null if no layer has the name. Throws UsageError if several have it.
const Node* layer_named(const Graph& graph, const std::string& name, const char* option) {
  std::vector<const Node*> found;
  for (const Node& node : graph.nodes)
    if (node.index >= 0 && node.name == name) found.push_back(&node);
  if (found.size() > 1)
    throw UsageError(option, ": ", found.size(), " layers have the name '", name, "': ",
                     joined(found, "; ", [&](const Node* n) { return description_of(graph, *n); }),
                     "; give the name of a blob, or rename the layers");
  return found.empty() ? nullptr : found[0];
}

[[noreturn]] void throw_unknown(const Graph& graph, const std::string& name, const char* option) {
  std::vector<std::string> others;
  for (const Node& node : graph.nodes) {
    others.push_back(node.name);
    if (option != kGraft)
      for (const ValueId id : node.outputs) others.push_back(graph.values[id].blob);
  }
  throw UsageError(option, ": the net '", graph.name, "' has no layer ",
                   option == kGraft ? "" : "or blob ", "'", name, "'",
                   nearest_name_hint(name, others));
}

const Node& find_layer(const Graph& graph, const std::string& name, const char* option) {
  if (const Node* found = layer_named(graph, name, option)) return *found;
  throw_unknown(graph, name, option);
}

using Outputs = std::vector<std::pair<std::string, ValueId>>;

/// Outputs of the layer `end`, or else the last value of the blob of this name.
Outputs outputs_of(const Graph& graph, const std::string& end) {
  Outputs outputs;
  if (const Node* last = layer_named(graph, end, kEnd)) {
    if (last->outputs.empty()) throw UsageError(kEnd, ": layer '", end, "' has no output");
    for (size_t i = 0; i < last->outputs.size(); ++i)
      outputs.push_back({port_name(end, i), last->outputs[i]});
    return outputs;
  }
  for (auto id = static_cast<ValueId>(graph.values.size()); id-- > 0;)
    if (graph.values[id].blob == end) return {{end, id}};
  throw_unknown(graph, end, kEnd);
}

/// Returns the value in `memory` that `node` modifies in place and the result, if any.
std::optional<std::pair<ValueId, ValueId>> in_place_in(const Graph& graph, const Node& node,
                                                       ValueId memory) {
  for (size_t i = 0; node.in_place && i < std::min(node.inputs.size(), node.outputs.size()); ++i) {
    const Value& output = graph.values[node.outputs[i]];
    if (node.inputs[i] >= 0 && output.memory == memory &&
        graph.values[node.inputs[i]].blob == output.blob)
      return std::pair(node.inputs[i], node.outputs[i]);
  }
  return std::nullopt;
}

struct Grafting {
  const std::string &end, &graft;
  std::string result() const { return end + "+" + graft; }
};

/// Returns `value` after the in-place layers on its memory, and after BatchNorm, Scale and ReLU if
/// they are its only readers.
ValueId after_its_block(Graph& graph, const Grafting& names, ValueId value) {
  std::vector<int> n_readers(graph.values.size());
  for (const Node& node : graph.nodes)
    for (const ValueId id : std::set(node.inputs.begin(), node.inputs.end()))
      if (id >= 0) ++n_readers[id];
  bool activated = false;
  const Node* skipped = nullptr;  // layer of the block, but `value` has other readers
  const Node* writer = nullptr;   // in-place layer on another value in the memory of `value`
  ValueId written = -1;
  auto node = std::ranges::find_if(graph.nodes, [&](const Node& n) {
    return std::ranges::find(n.outputs, value) != n.outputs.end();
  });
  for (++node; node != graph.nodes.end(); ++node) {
    const std::string& type = node->type;
    const bool is_of_block = type == "ReLU" || type == "BatchNorm" || type == "Scale";
    const auto in_place = in_place_in(graph, *node, graph.values[value].memory);
    std::optional<ValueId> next;
    if (in_place && in_place->first == value) {
      next = in_place->second;
    } else if (in_place) {
      writer = &*node;
      written = in_place->second;
      skipped = nullptr;
    } else if (node->index < 0) {
      if (node->inputs[1] == value) next = node->outputs[0];  // node of append_present()
    } else if (is_of_block && !activated && node->inputs == std::vector{value}) {
      if (n_readers[value] == 1)
        next = node->outputs.at(0);
      else
        skipped = &*node;
    }
    activated |= type == "ReLU" && (in_place || next);
    if (!next) continue;
    value = *next;
    writer = skipped = nullptr;
  }
  if (skipped)
    graph.warnings.push_back(str("'", names.result(), "' is grafted onto '", names.end,
                                 "' before the ", skipped->type, " '", skipped->name,
                                 "', because other layers read it, too; end the net at '",
                                 skipped->name, "' to graft after it"));
  return writer ? append_present(graph, written, writer->name, value) : value;
}

std::pair<std::string, ValueId> append_graft(Graph& graph, const Grafting& names, ValueId value) {
  Node node = find_layer(graph, names.graft, kGraft);
  if (node.inputs.size() != 1 || node.outputs.size() != 1)
    throw UsageError(kGraft, ": layer '", names.graft,
                     "' must have one input and one output to be grafted");
  value = after_its_block(graph, names, value);
  node.name = names.result();
  node.in_place = false;
  node.dangling = node.overwritten = "";
  node.inputs = {value};
  node.outputs = {static_cast<ValueId>(graph.values.size())};
  graph.values.push_back({node.name, node.outputs[0]});
  graph.nodes.push_back(std::move(node));
  return {names.result(), graph.nodes.back().outputs[0]};
}

}  // namespace

bool shares_memory(const caffe::LayerParameter& layer) {
  const std::string& type = layer.type();
  if (type == "Concat") return layer.bottom_size() == 1;
  if (type == "Slice") return layer.top_size() == 1;
  if (type == "Permute") {
    const auto& order = layer.permute_param().order();
    for (int i = 0; i < order.size(); ++i)
      if (order[i] != static_cast<uint32_t>(i)) return false;
    return true;
  }
  return type == "Split" || type == "Flatten" || type == "Reshape" || type == "Squeeze";
}

Graph resolve(const caffe::NetParameter& net) {
  Graph graph;
  graph.name = net.name();
  Builder builder(graph);
  for (const caffe::LayerParameter& layer : net.layer()) builder.add(layer);
  builder.finish();
  return graph;
}

Graph prune(const Graph& whole, const std::string& end, const std::string& graft) {
  Graph graph = whole;
  if (!graft.empty() && end.empty())
    throw UsageError(kGraft, " needs ", kEnd, ": the layer to graft onto");
  if (!end.empty()) {
    graph.outputs = outputs_of(graph, end);
    if (!graft.empty() && graph.outputs.size() > 1)
      throw UsageError(kGraft, ": the layer '", end, "' (", kEnd, ") has ", graph.outputs.size(),
                       " outputs; graft onto a layer with one");
    if (!graft.empty())
      graph.outputs = {append_graft(graph, {end, graft}, graph.outputs[0].second)};
  }

  std::vector<bool> needed(graph.values.size(), false);
  for (const auto& [name, value] : graph.outputs) needed[value] = true;
  std::vector<Node> kept;
  for (size_t i = graph.nodes.size(); i-- > 0;) {
    Node& node = graph.nodes[i];
    // Silence uses its input without an output, so the input stays an input of the full net.
    const bool silences = end.empty() && node.type == "Silence";
    if (!silences && std::none_of(node.outputs.begin(), node.outputs.end(),
                                  [&](ValueId id) { return needed[id]; }))
      continue;
    for (const ValueId input : node.inputs)
      if (input >= 0) needed[input] = true;
    kept.push_back(std::move(node));
  }
  std::reverse(kept.begin(), kept.end());
  for (const Node& node : end.empty() ? whole.nodes : kept) check_names(whole, node);
  graph.nodes = std::move(kept);
  return graph;
}

std::string port_name(const std::string& layer, size_t port) {
  return port == 0 ? layer : layer + "." + std::to_string(port);
}

}  // namespace revisit::proto
