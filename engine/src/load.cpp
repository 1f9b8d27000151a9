#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "layers/layers.h"
#include "net_impl.h"
#include "plan_impl.h"
#include "revisit/base/text.h"
#include "revisit/proto/net_file.h"
#include "schedule.h"

namespace revisit::engine {
namespace {

namespace fs = std::filesystem;

/// Throws for in-place layers that Caffe rejects for any type, or leaves undefined.
void check_in_place(const Graph& graph, const Node& node) {
  if (!node.in_place) return;
  if (!node.layer->allows_in_place())
    throw InputError(
        "this type of layer cannot work in place: its bottom and top have the same name; give "
        "the top its own name");
  for (const ValueId output : node.outputs)
    if (std::ranges::count_if(node.inputs, [&](ValueId input) {
          return graph.values[input].memory == graph.values[output].memory;
        }) > 1)
      throw InputError("works in place on '", graph.values[output].blob,
                       "', and another of its bottoms shares the memory; give the top its own "
                       "name");
}

void check_param_count(const Node& node) {
  const auto n_params = static_cast<size_t>(node.param.param_size());
  if (n_params > node.weights->size())
    throw InputError("expected at most one `param` for each of its ", node.weights->size(),
                     " weight blobs, found ", n_params);
}

proto::NetReadOptions reading(const LoadOptions& options) {
  return {.allow_unknown_fields = options.allow_unknown,
          .keep_unread = true,
          .types_with_weights = types_with_weights(),
          .limits = options.limits};
}

/// Rejects grafted layers with weights: no weights file has the copy's name, and its input differs.
void check_graft(const Net::Impl& net, const std::string& graft) {
  if (graft.empty()) return;  // first, because the net may have no layers
  const Node& last = net.graph.nodes.back();
  if (last.weights->empty()) return;
  throw UsageError(net.file, ": graft: layer '", graft, "' (", last.param.type(),
                   ") has weights, which a copy would lack; graft a layer without weights, "
                   "e.g. a pooling layer");
}

/// Losses may lack a top in Caffe, and Silence has none.
bool needs_top(const std::string& type) {
  return is_supported(type) && type != "Silence" && !type.ends_with("Loss");
}

/// In a full net, layers without an output do not run. An unread part of them is an error for a
/// supported type, because its `top` may be misspelled, else a warning.
void check_layers_not_run(const proto::NetFile& file, Net::Impl& net) {
  std::set<int> run;
  for (const Node& node : net.graph.nodes) run.insert(node.index);
  for (const proto::NetFile::Unread& part : file.unread) {
    if (!part.is_error || run.contains(part.layer)) continue;
    const std::string& type = file.net.layer(part.layer).type();
    if (type.empty() || is_supported(type)) throw InputError(part.what);
    net.warnings.push_back(str(part.what.what(), "; the layer writes no blob and is skipped"));
  }
  for (const caffe::LayerParameter& layer : file.net.layer())
    if (layer.top().empty() && needs_top(layer.type()))
      throw InputError(net.file, ": layer '", layer.name(), "' (", layer.type(), ") has no top");
}

void check_end(const proto::NetFile& file, const std::vector<std::string>& layers,
               const std::string& end) {
  const auto found = file.skipped.find(end);
  if (!end.empty() && found != file.skipped.end() && std::ranges::find(layers, end) == layers.end())
    throw UsageError("end: the layer '", end, "' is not part of the net: ", found->second);
}

/// Warns of a net without outputs, because Silence layers read them all.
void warn_of_silence(const proto::Graph& whole, Net::Impl& net) {
  std::vector<std::string> blobs;
  for (const proto::Node& node : whole.nodes)
    for (const ValueId id : node.type == "Silence" ? node.inputs : std::vector<ValueId>())
      if (id >= 0) blobs.push_back(whole.values[id].blob);
  net.warnings.push_back(str(net.file, ": the net has no output, because Silence layers read '",
                             joined(blobs, "', '"), "'; end names the blob to output"));
}

/// Adds the parameters of the layers of a file to the nodes of its graph.
Graph attach(const caffe::NetParameter& file, proto::Graph graph) {
  std::map<std::string, int> first;
  for (int i = 0; i < file.layer_size(); ++i) first.try_emplace(file.layer(i).name(), i);
  Graph result{std::move(graph.name), {}, std::move(graph.values), std::move(graph.outputs)};
  for (proto::Node& resolved : graph.nodes) {
    Node& node = result.nodes.emplace_back(Node{std::move(resolved)});
    if (node.index >= 0) {
      node.param = file.layer(node.index);
      const auto found = first.find(node.name);  // a grafted layer has a name of its own
      node.is_first_of_name = found != first.end() && found->second == node.index;
    } else {
      node.param.set_type(node.type);
      node.layer = make_reshaped_like();
    }
  }
  return result;
}

std::shared_ptr<Net::Impl> load_structure(proto::NetFile file, const std::string& name,
                                          const LoadOptions& options) {
  auto net = std::make_shared<Net::Impl>();
  net->file = name;
  net->warnings = std::move(file.warnings);
  try {
    for (const caffe::LayerParameter& layer : file.net.layer())
      net->layer_names.push_back(layer.name());
    check_end(file, net->layer_names, options.end);
    net->sharing = find_sharing(file.net);
    net->own_shared = find_own_shared(file.net);
    proto::Graph whole = proto::resolve(file.net);
    whole.dropped = std::move(file.dropped);
    proto::Graph graph = proto::prune(whole, options.end, options.graft);
    if (graph.outputs.empty()) warn_of_silence(whole, *net);
    for (const std::string& warning : graph.warnings)
      net->warnings.push_back(str(net->file, ": ", warning));
    net->graph = attach(file.net, std::move(graph));
  } catch (const InputError& error) {
    throw InputError(net->file, ": ", error);
  }
  std::multimap<int, const proto::NetFile::Unread*> unread_by_layer;
  for (const proto::NetFile::Unread& part : file.unread) unread_by_layer.emplace(part.layer, &part);
  if (options.end.empty()) check_layers_not_run(file, *net);
  if (net->graph.nodes.empty())
    throw InputError(net->file, ": none of its layers writes a blob, so there is nothing to run");
  for (Node& node : net->graph.nodes) {
    const auto [begin, end] = unread_by_layer.equal_range(node.index);
    // An unsupported type is reported first, because its parameters are unknown, too.
    if (begin != end && !node.param.type().empty())
      at_layer(net->file, node, [&] { check_type(node.param); });
    for (auto part = begin; part != end; ++part) {
      if (part->second->is_error) throw InputError(part->second->what);
      net->warnings.emplace_back(part->second->what.what());
    }
    at_layer(net->file, node, [&] {
      if (!node.layer) node.layer = make_layer(node.param);
      if (node.layer) check_in_place(net->graph, node);
    });
    if (const std::string how = ambiguity_of(node.param); !how.empty())
      net->warnings.push_back(str(place_of(net->file, node), " is computed ", how));
  }

  net->sensitive = sensitive_values(net->graph);
  const std::vector<Shape> shapes = infer_shapes(*net, options.inputs);
  for (Node& node : net->graph.nodes) {
    if (!node.layer) {
      for (const ValueId id : node.outputs)
        net->inputs.push_back({net->graph.values[id].blob, shapes[id]});
      continue;
    }
    at_layer(net->file, node, [&] {
      for (Shape& shape : node.layer->weight_shapes(shapes_of(node.inputs, shapes)))
        node.weights->push_back({std::move(shape), {}});
      check_param_count(node);
    });
  }
  check_graft(*net, options.graft);
  check_sharing(*net);
  return net;
}

std::shared_ptr<Net::Impl> load_structure(const fs::path& prototxt, const LoadOptions& options) {
  return load_structure(proto::read_net(prototxt, reading(options)), prototxt.string(), options);
}

}  // namespace

Net Net::load(const fs::path& prototxt, const fs::path& weights, const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  load_weights(*net, proto::WeightsFile::open(weights, options.limits), options);
  return Net(std::move(net));
}

Net Net::load_from_memory(std::string_view prototxt, std::string_view weights,
                          const LoadOptions& options) {
  const std::string name = "<prototxt>";
  auto net = load_structure(proto::parse_net(std::string(prototxt), name, reading(options)), name,
                            options);
  load_weights(*net, proto::WeightsFile::open(FileCursor(weights, "<weights>"), options.limits),
               options);
  return Net(std::move(net));
}

Net Net::load_with_random_weights(const fs::path& prototxt, uint64_t seed,
                                  const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  check_weight_bytes(*net, options.limits.weight_bytes);
  fill_randomly(*net, seed);
  return Net(std::move(net));
}

Net Net::load_without_weights(const fs::path& prototxt, const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  if (has_own_weights(*net)) load_weights(*net, nullptr, options);
  return Net(std::move(net));
}

std::vector<std::string> input_blobs(const fs::path& prototxt, const LoadOptions& options) {
  const proto::NetFile file = proto::read_net(prototxt, reading(options));
  std::vector<std::string> blobs;
  for (const caffe::LayerParameter& layer : file.net.layer())
    if (layer.type() == kInputType)
      blobs.insert(blobs.end(), layer.top().begin(), layer.top().end());
  return blobs;
}

const std::string& Net::name() const {
  return impl_->graph.name;
}
const std::vector<Port>& Net::inputs() const {
  return impl_->inputs;
}
const std::vector<std::string>& Net::layer_names() const {
  return impl_->layer_names;
}
const std::vector<std::string>& Net::warnings() const {
  return impl_->warnings;
}
std::vector<std::pair<std::string, std::vector<View<const float>>>> Net::weights() const {
  if (!impl_->has_weights) throw UsageError(impl_->file + ": the net was loaded without weights");
  std::vector<std::pair<std::string, std::vector<View<const float>>>> weights;
  for (const Node& node : impl_->graph.nodes) {
    if (node.weights->empty()) continue;
    std::vector<View<const float>> blobs;
    for (const Tensor& weight : *node.weights)
      blobs.push_back({weight.values.data(), weight.shape});
    weights.emplace_back(node.name, std::move(blobs));
  }
  return weights;
}

uint64_t Net::weight_bytes_read() const {
  return impl_->weight_bytes_read;
}

int64_t Net::packed_weight_bytes() const {
  return impl_->packed_weights.bytes_in_use();
}

std::vector<std::string> Net::outputs() const {
  std::vector<std::string> names;
  for (const auto& [name, value] : impl_->graph.outputs) names.push_back(name);
  return names;
}

}  // namespace revisit::engine
