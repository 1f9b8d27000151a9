#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include "net_impl.h"
#include "registry.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"

namespace revisit::engine {
namespace {

namespace fs = std::filesystem;

/// Everything but the weights' values; their shapes are set.
std::shared_ptr<Net::Impl> load_structure(const fs::path& prototxt, const LoadOptions& options) {
  proto::NetFile file = proto::read_net(prototxt, {options.allow_unknown});
  auto net = std::make_shared<Net::Impl>();
  net->file = prototxt.string();
  net->warnings = std::move(file.warnings);
  try {
    const Graph whole = parse(file.net);
    for (const Node& node : whole.nodes) net->layer_names.push_back(node.name);
    net->graph = prune(whole, options.truncation);
  } catch (const InputError& error) {
    throw InputError(net->file + ": " + error.what());
  }
  for (const Node& node : net->graph.nodes) {
    try {
      net->nodes.push_back({node.param.type() == "Input" ? nullptr : make_layer(node.param), {}});
    } catch (const Error&) {
      rethrow_at(net->file, node);
    }
  }

  const std::vector<Shape> shapes = infer_shapes(*net, options.inputs);
  for (size_t i = 0; i < net->nodes.size(); ++i) {
    const Node& node = net->graph.nodes[i];
    if (!net->nodes[i].layer) {
      for (const ValueId id : node.outputs)
        net->inputs.push_back({net->graph.values[id].blob, shapes[id]});
      continue;
    }
    std::vector<Shape> inputs;
    for (const ValueId id : node.inputs) inputs.push_back(shapes[id]);
    for (Shape& shape : net->nodes[i].layer->weight_shapes(inputs))
      net->nodes[i].weights.push_back({std::move(shape), {}});
  }
  return net;
}

/// Caffe's rule (SEMANTICS section 8): legacy blobs compare right-aligned with the last 4 axes,
/// others exactly.
bool shape_fits(const proto::Blob& blob, const Shape& wanted) {
  if (!blob.legacy_shape) return blob.shape == wanted.axes();
  if (wanted.rank() > 4) return false;
  std::vector<int64_t> padded(4 - wanted.rank(), 1);
  padded.insert(padded.end(), wanted.axes().begin(), wanted.axes().end());
  return blob.shape == padded;
}

std::string text(const std::vector<int64_t>& axes) {
  std::string result;
  for (const int64_t size : axes) result += (result.empty() ? "" : "x") + std::to_string(size);
  return result.empty() ? "scalar" : result;
}

void take_blobs(const std::string& weights_file, const Node& node, LoadedNode& loaded,
                std::vector<proto::Blob> blobs) {
  const std::string place =
      str(weights_file, ": layer '", node.name, "' (", node.param.type(), ")");
  if (blobs.size() != loaded.weights.size())
    throw InputError(str(place, ": expected ", loaded.weights.size(), " blobs, found ",
                         blobs.size(), "; these weights belong to another network"));
  for (size_t i = 0; i < blobs.size(); ++i) {
    if (!shape_fits(blobs[i], loaded.weights[i].shape))
      throw InputError(str(place, " blob ", i, ": expected shape ", loaded.weights[i].shape,
                           ", found ", text(blobs[i].shape),
                           "; these weights belong to another network"));
    loaded.weights[i].values = std::move(blobs[i].data);
  }
}

std::string joined(const std::vector<std::string>& names) {
  std::string result;
  constexpr size_t kMost = 8;
  for (size_t i = 0; i < std::min(names.size(), kMost); ++i) result += (i ? ", " : "") + names[i];
  if (names.size() > kMost) result += str(", and ", names.size() - kMost, " more");
  return result;
}

void load_weights(Net::Impl& net, const fs::path& weights, bool allow_missing) {
  const std::unique_ptr<proto::WeightsFile> file = proto::WeightsFile::open(weights);

  // Weights are matched by layer name; of layers that share one, the first takes them.
  std::map<std::string, size_t> by_name;
  for (size_t i = 0; i < net.nodes.size(); ++i) by_name.try_emplace(net.graph.nodes[i].name, i);

  std::set<size_t> filled;
  std::vector<std::string> unused;
  for (size_t i = 0; i < file->layers().size(); ++i) {
    const proto::WeightsFile::Layer& layer = file->layers()[i];
    if (layer.n_blobs == 0) continue;
    const auto found = by_name.find(layer.name);
    if (found != by_name.end()) {
      take_blobs(weights.string(), net.graph.nodes[found->second], net.nodes[found->second],
                 file->read(i));
      filled.insert(found->second);
    } else if (std::find(net.layer_names.begin(), net.layer_names.end(), layer.name) ==
               net.layer_names.end()) {
      unused.push_back(layer.name);
    }
  }

  std::vector<std::string> missing;
  for (size_t i = 0; i < net.nodes.size(); ++i) {
    if (net.nodes[i].weights.empty() || filled.count(i)) continue;
    missing.push_back(net.graph.nodes[i].name);
    for (Tensor& weight : net.nodes[i].weights) weight.values.assign(weight.shape.elements(), 0.0F);
  }
  if (!missing.empty() && !allow_missing)
    throw InputError(str(weights.string(), ": no weights for the layers ", joined(missing), " of ",
                         net.file,
                         unused.empty() ? "" : str("; the file has weights for ", joined(unused)),
                         " (--allow-missing would make them zero)"));
  if (!missing.empty())
    net.warnings.push_back(str("layers without weights, set to zero: ", joined(missing)));
  if (!unused.empty())
    net.warnings.push_back(str(weights.string(), ": weights that no layer uses: ", joined(unused)));
  net.weight_bytes_read = file->bytes_read();
  net.has_weights = true;
}

/// splitmix64 (Steele, Lea, Flood 2014): the same numbers on every platform.
uint64_t next_random(uint64_t& state) {
  uint64_t z = state += 0x9E3779B97F4A7C15ULL;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

/// Uniform with the variance of He et al. 2015, so that activations keep their scale over depth.
void fill_randomly(Net::Impl& net, uint64_t seed) {
  uint64_t state = seed;
  for (LoadedNode& node : net.nodes) {
    for (Tensor& weight : node.weights) {
      const int64_t fan_in =
          weight.shape.rank() > 1 ? weight.shape.product(1, weight.shape.rank()) : 1;
      const double limit =
          weight.shape.rank() > 1 ? std::sqrt(6.0 / static_cast<double>(fan_in)) : 0.1;
      weight.values.resize(weight.shape.elements());
      for (float& value : weight.values) {
        const double unit = static_cast<double>(next_random(state) >> 11) * 0x1.0p-53;  // [0, 1)
        value = static_cast<float>(limit * (2 * unit - 1));
      }
    }
  }
  net.has_weights = true;
}

}  // namespace

Net Net::load(const fs::path& prototxt, const fs::path& weights, const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  load_weights(*net, weights, options.allow_missing);
  return Net(std::move(net));
}

Net Net::load_with_random_weights(const fs::path& prototxt, uint64_t seed,
                                  const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  fill_randomly(*net, seed);
  return Net(std::move(net));
}

Net Net::load_without_weights(const fs::path& prototxt, const LoadOptions& options) {
  auto net = load_structure(prototxt, options);
  net->has_weights = std::all_of(net->nodes.begin(), net->nodes.end(),
                                 [](const LoadedNode& node) { return node.weights.empty(); });
  return Net(std::move(net));
}

std::vector<std::string> input_blobs(const fs::path& prototxt, bool allow_unknown) {
  const proto::NetFile file = proto::read_net(prototxt, {allow_unknown});
  std::vector<std::string> blobs;
  for (const caffe::LayerParameter& layer : file.net.layer())
    if (layer.type() == "Input") blobs.insert(blobs.end(), layer.top().begin(), layer.top().end());
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
bool Net::has_weights() const {
  return impl_->has_weights;
}
const std::vector<std::string>& Net::warnings() const {
  return impl_->warnings;
}
uint64_t Net::weight_bytes_read() const {
  return impl_->weight_bytes_read;
}

std::vector<std::string> Net::outputs() const {
  std::vector<std::string> names;
  for (const Graph::Output& output : impl_->graph.outputs) names.push_back(output.name);
  return names;
}

}  // namespace revisit::engine
