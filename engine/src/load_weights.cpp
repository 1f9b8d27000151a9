#include "load_weights.h"

#include <algorithm>
#include <set>
#include <span>

#include "revisit/base/joined.h"

namespace revisit::engine {
namespace {

/// Caffe's rule (docs/LAYERS.md point 8): legacy blobs compare right-aligned with the last 4 axes.
bool shape_fits(const proto::Blob& blob, const Shape& wanted) {
  if (!blob.legacy_shape) return blob.shape == wanted.axes();
  if (wanted.rank() > 4) return false;
  std::vector<int64_t> padded(4 - wanted.rank(), 1);
  padded.insert(padded.end(), wanted.axes().begin(), wanted.axes().end());
  return blob.shape == padded;
}

/// The first eight names, and how many more there are.
std::string first_of(const std::vector<std::string>& names) {
  constexpr size_t kMost = 8;
  const std::span<const std::string> shown(names.data(), std::min(names.size(), kMost));
  const size_t more = names.size() - shown.size();
  return joined(shown, ", ") + (more > 0 ? str(", and ", more, " more") : "");
}

/// A blob of a kept layer.
struct Place {
  size_t node, blob;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const Place&, const Place&) = default;
};

/// Reads the weights of all kept layers.
class Loader {
 public:
  Loader(const Net::Impl& net, std::unique_ptr<proto::WeightsFile> file)
      : net_(net),
        path_(file->file().string()),
        file_(std::move(file)),
        weights_(net.graph.nodes.size()) {
    for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
      const Node& node = net.graph.nodes[i];
      for (const Tensor& weight : node.weights) weights_[i].push_back({weight.shape, {}});
      by_name_.try_emplace(node.name, i);  // of layers that share a name, the first has the weights
      for (size_t b = 0; b < node.weights.size(); ++b) {
        const auto group = net.sharing.find({node.name, b});
        if (group != net.sharing.end()) members_[group->second].push_back({i, b});
      }
    }
  }

  void read_all() {
    for (size_t i = 0; i < file_->layers().size(); ++i) {
      const proto::WeightsFile::Layer& layer = file_->layers()[i];
      if (layer.n_blobs == 0) continue;
      if (is_wanted(layer))
        take(layer.name, file_->read(i));
      else if (std::find(net_.layer_names.begin(), net_.layer_names.end(), layer.name) ==
               net_.layer_names.end())
        unused_.push_back(layer.name);
    }
  }

  /// Throws when weights are missing that may not be; returns warnings.
  std::vector<std::string> finish(bool allow_missing) {
    std::vector<std::string> missing, warnings;
    for (size_t i = 0; i < net_.graph.nodes.size(); ++i) {
      std::vector<Tensor>& weights = weights_[i];
      for (size_t b = 0; b < weights.size(); ++b) {
        if (filled_.count({i, b})) continue;
        if (missing.empty() || missing.back() != net_.graph.nodes[i].name)
          missing.push_back(net_.graph.nodes[i].name);
        if (allow_missing)
          weights[b].values.assign(static_cast<size_t>(weights[b].shape.elements()), 0.0F);
      }
    }
    if (!missing.empty() && !allow_missing)
      throw InputError(path_, ": no weights for the layers ", first_of(missing), " of ", net_.file,
                       unused_.empty() ? "" : str("; the file has weights for ", first_of(unused_)),
                       " (", CppName{"LoadOptions::allow_missing"}, " makes them zero)");
    if (!missing.empty())
      warnings.push_back(str("layers without weights, set to zero: ", first_of(missing)));
    if (!unused_.empty())
      warnings.push_back(str(path_, ": weights that no layer uses: ", first_of(unused_)));
    return warnings;
  }

  std::vector<Tensor> take(size_t node) { return std::move(weights_[node]); }
  uint64_t bytes_read() const { return file_->bytes_read(); }

 private:
  /// A layer that is kept, or one that shares a blob with a kept layer.
  bool is_wanted(const proto::WeightsFile::Layer& layer) const {
    if (by_name_.count(layer.name)) return true;
    for (size_t b = 0; b < layer.n_blobs; ++b) {
      const auto group = net_.sharing.find({layer.name, b});
      if (group != net_.sharing.end() && members_.count(group->second)) return true;
    }
    return false;
  }

  void take(const std::string& layer, std::vector<proto::Blob> blobs) {
    const auto own = by_name_.find(layer);
    if (own != by_name_.end()) check(own->second, blobs);
    for (size_t b = 0; b < blobs.size(); ++b) {
      if (blobs[b].absent) continue;
      const auto group = net_.sharing.find({layer, b});
      if (group != net_.sharing.end()) {
        const auto members = members_.find(group->second);
        if (members != members_.end())
          for (const Place& place : members->second) put(place, layer, b, blobs[b].data);
      } else if (own != by_name_.end()) {
        put({own->second, b}, layer, b, std::move(blobs[b].data));
      }
    }
  }

  void check(size_t node, const std::vector<proto::Blob>& blobs) const {
    const std::vector<Tensor>& weights = weights_[node];
    // A file may leave blobs out that it has under another layer, which shares them.
    size_t n_expected = weights.size();
    while (n_expected > blobs.size() &&
           net_.sharing.contains({net_.graph.nodes[node].name, n_expected - 1}))
      --n_expected;
    if (blobs.size() != n_expected)
      throw InputError(place_text(node), ": expected ", weights.size(), " blobs, found ",
                       blobs.size(), "; these weights belong to another network");
    for (size_t b = 0; b < blobs.size(); ++b)
      if (!blobs[b].absent && !shape_fits(blobs[b], weights[b].shape))
        throw InputError(place_text(node), " blob ", b, ": expected shape ", weights[b].shape,
                         ", found ", text_of(blobs[b].shape),
                         "; these weights belong to another network");
  }

  void put(const Place& place, const std::string& layer, size_t blob, std::vector<float> values) {
    Tensor& weight = weights_[place.node][place.blob];
    if (values.size() != static_cast<size_t>(weight.shape.elements()))
      throw InputError(place_text(place.node), " blob ", place.blob, ": shares blob ", blob,
                       " of layer '", layer, "', which has ", values.size(), " values instead of ",
                       weight.shape.elements());
    weight.values = std::move(values);
    filled_.insert(place);
  }

  std::string place_text(size_t node) const {
    const Node& n = net_.graph.nodes[node];
    return str(path_, ": layer '", n.name, "' (", n.param.type(), ")");
  }

  const Net::Impl& net_;
  std::string path_;
  std::unique_ptr<proto::WeightsFile> file_;
  std::vector<std::vector<Tensor>> weights_;  // as net_.graph.nodes
  std::map<std::string, size_t> by_name_;
  std::map<std::string, std::vector<Place>> members_;  // kept blobs of each sharing group
  std::set<Place> filled_;
  std::vector<std::string> unused_;
};

}  // namespace

Sharing find_sharing(const Graph& whole) {
  Sharing sharing;
  for (const Node& node : whole.nodes)
    for (int b = 0; b < node.param.param_size(); ++b)
      if (!node.param.param(b).name().empty())
        sharing.try_emplace({node.name, static_cast<size_t>(b)}, node.param.param(b).name());
  return sharing;
}

void check_sharing(const Net::Impl& net) {
  std::map<std::string, std::pair<const Node*, const Shape*>> owners;  // by parameter name
  for (const Node& node : net.graph.nodes) {
    for (size_t b = 0; b < node.weights.size(); ++b) {
      const auto group = net.sharing.find({node.name, b});
      if (group == net.sharing.end()) continue;
      const Shape& shape = node.weights[b].shape;
      const auto [owner, is_new] = owners.try_emplace(group->second, &node, &shape);
      if (is_new) continue;
      const Shape& owned = *owner->second.second;
      const bool permissive =
          static_cast<int>(b) < node.param.param_size() &&
          node.param.param(static_cast<int>(b)).share_mode() == caffe::ParamSpec::PERMISSIVE;
      if (permissive ? owned.elements() != shape.elements() : owned != shape)
        throw InputError(net.file, ": layer '", node.name, "' (", node.param.type(), ") blob ", b,
                         " is ", shape, ", but it shares the parameter '", group->second,
                         "' with layer '", owner->second.first->name, "', where it is ", owned);
    }
  }
}

void load_weights(Net::Impl& net, std::unique_ptr<proto::WeightsFile> weights,
                  const LoadOptions& options) {
  Loader loader(net, std::move(weights));
  loader.read_all();
  const std::vector<std::string> warnings = loader.finish(options.allow_missing);
  net.warnings.insert(net.warnings.end(), warnings.begin(), warnings.end());
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) net.graph.nodes[i].weights = loader.take(i);
  net.weight_bytes_read = loader.bytes_read();
  net.has_weights = true;
}

}  // namespace revisit::engine
