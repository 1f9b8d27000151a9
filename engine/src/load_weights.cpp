#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <span>

#include "net_impl.h"
#include "plan_impl.h"
#include "revisit/base/hash.h"
#include "revisit/base/text.h"
#include "revisit/proto/net_file.h"

namespace revisit::engine {
namespace {

/// Caffe's rule (docs/reference/LAYERS.md point 8): legacy shapes compare right-aligned.
bool shape_fits(const proto::Blob& blob, const Shape& wanted) {
  if (!blob.legacy_shape) return blob.shape == wanted.axes();
  if (wanted.rank() > blob.shape.size()) return false;
  std::vector<int64_t> padded(blob.shape.size() - wanted.rank(), 1);
  padded.insert(padded.end(), wanted.axes().begin(), wanted.axes().end());
  return blob.shape == padded;
}

std::string first_of(const std::vector<std::string>& names) {
  constexpr size_t kMost = 8;
  const std::span<const std::string> shown(names.data(), std::min(names.size(), kMost));
  const size_t more = names.size() - shown.size();
  return joined(shown, ", ") + (more > 0 ? str(", and ", more, " more") : "");
}

struct Place {
  size_t node, blob;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const Place&, const Place&) = default;
};

class Loader {
 public:
  Loader(const Net::Impl& net, std::unique_ptr<proto::WeightsFile> file)
      : net_(net),
        path_(file ? file->file().string() : net.file),
        file_(std::move(file)),
        weights_(net.graph.nodes.size()) {
    for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
      const Node& node = net.graph.nodes[i];
      for (const Tensor& weight : *node.weights) weights_[i].push_back({weight.shape, {}});
      if (node.is_first_of_name) by_name_.emplace(node.name, i);
      for (size_t b = 0; b < node.weights->size(); ++b)
        if (const std::string group = parameter_of(node, b); !group.empty())
          members_[group].push_back({i, b});
    }
  }

  void take_own() {
    caffe::NetParameter own;
    std::vector<size_t> nodes;
    for (size_t i = 0; i < net_.graph.nodes.size(); ++i) {
      const Node& node = net_.graph.nodes[i];
      if (node.param.blobs_size() == 0) continue;
      caffe::LayerParameter& layer = *own.add_layer();
      layer.set_name(node.name);
      *layer.mutable_blobs() = node.param.blobs();
      nodes.push_back(i);
    }
    std::vector<std::string> groups;
    for (const auto& [group, places] : members_) {
      const auto owner = net_.own_shared.find(group);
      if (owner == net_.own_shared.end()) continue;
      *own.add_layer() = owner->second;
      groups.push_back(group);
    }
    if (own.layer_size() == 0) return;
    const std::string bytes = proto::net_bytes(own);
    const auto file = proto::WeightsFile::open(FileCursor(bytes, net_.file));
    for (size_t i = 0; i < nodes.size(); ++i) {
      std::vector<proto::Blob> blobs = file->read(i);
      const Node& node = net_.graph.nodes[nodes[i]];
      check(net_.file, nodes[i], blobs);
      for (size_t b = 0; b < blobs.size(); ++b)
        if (parameter_of(node, b).empty())
          put({nodes[i], b}, node.name, b, std::move(blobs[b].data));
    }
    for (size_t i = 0; i < groups.size(); ++i)
      fill(groups[i], {}, net_.own_shared.at(groups[i]).name(), 0,
           std::move(file->read(nodes.size() + i).at(0).data));
  }

  void read_all() {
    if (!file_) return;
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

  /// Throws InputError if required weights are missing; returns warnings.
  std::vector<std::string> finish(const LoadOptions& options) {
    const bool allow_missing = options.allow_missing;
    std::vector<std::string> missing, warnings;
    for (size_t i = 0; i < net_.graph.nodes.size(); ++i) {
      for (size_t b = 0; b < weights_[i].size(); ++b) {
        if (filled_.count({i, b})) continue;
        const Node& node = net_.graph.nodes[i];
        const std::string name = node.is_first_of_name
                                     ? node.name
                                     : node.name + " (another layer of this name has them)";
        if (missing.empty() || missing.back() != name) missing.push_back(name);
        if (allow_missing) initialize({i, b}, options.fill_seed);
      }
    }
    if (!missing.empty() && !allow_missing)
      throw InputError(path_, ": no weights for the layers ", first_of(missing), " of ", net_.file,
                       unused_.empty() ? "" : str("; the file has weights for ", first_of(unused_)),
                       " (allow missing fills them as Caffe would before training)");
    if (!missing.empty())
      warnings.push_back(str("layers without weights, filled by their fillers as before training: ",
                             first_of(missing)));
    if (!unused_.empty())
      warnings.push_back(str(path_, ": weights that no layer uses: ", first_of(unused_)));
    return warnings;
  }

  std::vector<Tensor> take(size_t node) { return std::move(weights_[node]); }
  uint64_t bytes_read() const { return file_ ? file_->bytes_read() : 0; }

 private:
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
    if (own != by_name_.end()) check(path_, own->second, blobs);
    for (size_t b = 0; b < blobs.size(); ++b) {
      if (blobs[b].absent) continue;
      const auto group = net_.sharing.find({layer, b});
      std::optional<Place> place;
      if (own != by_name_.end()) place = {own->second, b};
      fill(group == net_.sharing.end() ? "" : group->second, place, layer, b,
           std::move(blobs[b].data));
    }
  }

  /// Sets all members of the parameter `group`; without a group only `own`, if any.
  void fill(const std::string& group, const std::optional<Place>& own, const std::string& layer,
            size_t blob, std::vector<float> values) {
    if (!group.empty()) {
      const auto members = members_.find(group);
      if (members == members_.end()) return;
      for (const Place& place : members->second) put(place, layer, blob, values);
    } else if (own) {
      put(*own, layer, blob, std::move(values));
    }
  }

  void initialize(const Place& place, uint64_t seed) {
    const Node& node = net_.graph.nodes[place.node];
    const std::string group = parameter_of(node, place.blob);
    std::vector<float> values;
    try {
      values = initial_weights(node.param, place.blob, weights_[place.node][place.blob].shape,
                               mixed_bits(seed + static_cast<uint64_t>(node.index)));
    } catch (const InputError& error) {
      throw InputError(place_of(net_.file, node), ": ", error);
    }
    fill(group, place, node.name, place.blob, std::move(values));
  }

  void check(const std::string& file, size_t node, const std::vector<proto::Blob>& blobs) const {
    const std::vector<Tensor>& weights = weights_[node];
    const auto place = [&] { return place_of(file, net_.graph.nodes[node]); };
    // A file can lack trailing blobs that it stores under another layer, which shares them.
    size_t n_expected = weights.size();
    while (n_expected > blobs.size() &&
           !parameter_of(net_.graph.nodes[node], n_expected - 1).empty())
      --n_expected;
    if (blobs.size() != n_expected)
      throw InputError(place(), ": expected ", weights.size(), " blobs, found ", blobs.size(), "; ",
                       weights.size() == 3 && blobs.size() == 5 &&
                               net_.graph.nodes[node].param.type() == "BatchNorm"
                           ? "with scale and bias, as in NVIDIA's fork, it needs batch_norm_param "
                             "{ scale_bias: true }"
                           : "these weights belong to another network");
    for (size_t b = 0; b < blobs.size(); ++b)
      if (!blobs[b].absent && !shape_fits(blobs[b], weights[b].shape))
        throw InputError(place(), " blob ", b, ": expected shape ", weights[b].shape, ", found ",
                         shape_text(blobs[b].shape), "; these weights belong to another network");
  }

  void put(const Place& place, const std::string& layer, size_t blob, std::vector<float> values) {
    Tensor& weight = weights_[place.node][place.blob];
    if (values.size() != static_cast<size_t>(weight.shape.elements()))
      throw InputError(place_of(path_, net_.graph.nodes[place.node]), " blob ", place.blob,
                       ": shares blob ", blob, " of layer '", layer, "', which has ", values.size(),
                       " values instead of ", weight.shape.elements());
    weight.values = std::move(values);
    filled_.insert(place);
  }

  const Net::Impl& net_;
  std::string path_;
  std::unique_ptr<proto::WeightsFile> file_;
  std::vector<std::vector<Tensor>> weights_;
  std::map<std::string, size_t> by_name_;
  std::map<std::string, std::vector<Place>> members_;  // kept blobs of each parameter name
  std::set<Place> filled_;
  std::vector<std::string> unused_;
};

}  // namespace

std::string parameter_of(const Node& node, size_t blob) {
  return blob < static_cast<size_t>(node.param.param_size())
             ? node.param.param(static_cast<int>(blob)).name()
             : "";
}

Sharing find_sharing(const caffe::NetParameter& file) {
  Sharing sharing;
  std::set<std::string> names;
  for (const caffe::LayerParameter& layer : file.layer()) {
    if (!names.insert(layer.name()).second) continue;
    for (int b = 0; b < layer.param_size(); ++b)
      if (!layer.param(b).name().empty())
        sharing.try_emplace({layer.name(), static_cast<size_t>(b)}, layer.param(b).name());
  }
  return sharing;
}

OwnShared find_own_shared(const caffe::NetParameter& file) {
  OwnShared own;
  std::set<std::string> known;
  for (const caffe::LayerParameter& layer : file.layer())
    for (int b = 0; b < layer.param_size(); ++b)
      if (const std::string& group = layer.param(b).name();
          !group.empty() && known.insert(group).second && b < layer.blobs_size()) {
        own[group].set_name(layer.name());
        *own[group].add_blobs() = layer.blobs(b);
      }
  return own;
}

bool has_own_weights(const Net::Impl& net) {
  for (const Node& node : net.graph.nodes)
    for (size_t b = 0; b < node.weights->size(); ++b) {
      const std::string group = parameter_of(node, b);
      if (group.empty() ? b >= static_cast<size_t>(node.param.blobs_size())
                        : !net.own_shared.contains(group))
        return false;
    }
  return true;
}

void check_sharing(const Net::Impl& net) {
  std::map<std::string, std::pair<const Node*, const Shape*>> owners;
  for (const Node& node : net.graph.nodes) {
    for (size_t b = 0; b < node.weights->size(); ++b) {
      const std::string group = parameter_of(node, b);
      if (group.empty()) continue;
      const Shape& shape = (*node.weights)[b].shape;
      const auto [owner, is_new] = owners.try_emplace(group, &node, &shape);
      if (is_new) continue;
      const Shape& owned = *owner->second.second;
      const bool permissive =
          static_cast<int>(b) < node.param.param_size() &&
          node.param.param(static_cast<int>(b)).share_mode() == caffe::ParamSpec::PERMISSIVE;
      if (permissive ? owned.elements() != shape.elements() : owned != shape)
        throw InputError(place_of(net.file, node), " blob ", b, " is ", shape,
                         ", but it shares the parameter '", group, "' with layer '",
                         owner->second.first->name, "', where it is ", owned);
    }
  }
}

/// Warns of a BatchNorm whose mean Caffe would ignore.
void warn_of_statistics(Net::Impl& net, const Node& node) {
  const std::vector<Tensor>& weights = *node.weights;
  if (node.param.type() != "BatchNorm" || weights.size() != 3) return;
  const auto& mean = weights[0].values;
  if (weights[2].values.at(0) != 0 || std::ranges::all_of(mean, [](float m) { return m == 0; }))
    return;
  net.warnings.push_back(
      str(place_of(net.file, node), ": its correction (blob 2) is 0, although ",
          "its mean is not: as in Caffe, it computes x / sqrt(eps); if NVIDIA's fork wrote the ",
          "weights, write 1 into blob 2"));
}

void load_weights(Net::Impl& net, std::unique_ptr<proto::WeightsFile> weights,
                  const LoadOptions& options) {
  check_weight_bytes(net, options.limits.weight_bytes);
  Loader loader(net, std::move(weights));
  loader.take_own();
  loader.read_all();
  const std::vector<std::string> warnings = loader.finish(options);
  net.warnings.insert(net.warnings.end(), warnings.begin(), warnings.end());
  for (size_t i = 0; i < net.graph.nodes.size(); ++i) {
    *net.graph.nodes[i].weights = loader.take(i);
    net.graph.nodes[i].param.clear_blobs();
    warn_of_statistics(net, net.graph.nodes[i]);
  }
  net.own_shared.clear();
  net.weight_bytes_read = loader.bytes_read();
  net.has_weights = true;
}

}  // namespace revisit::engine
