#include <algorithm>
#include <limits>
#include <set>

#include "caffe_schema.pb.h"
#include "cli/net_options.h"
#include "models/models.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"

namespace revisit::models {
namespace {

namespace fs = std::filesystem;

constexpr const char* kUntrainedPrefix = "untrained_";

/// The prototxt of one of our nets is written to `folder`. Throws UsageError for a word that is
/// neither a net nor a file.
fs::path prototxt_of(const fs::path& net, const fs::path& folder) {
  const char* const own = own_net(net.string());
  if (!own && !net.has_extension() && !fs::exists(net))
    throw UsageError("--net: expected a prototxt, ", joined(own_net_names(), ", "), "; found '",
                     net.string(), "'", nearest_name_hint(net.string(), own_net_names()));
  if (!own) return net;
  make_folder(folder);
  const fs::path file = folder / str(net.string(), "_random.prototxt");
  write_atomically(file, [&](std::ostream& out) { out << own; });
  return file;
}

caffe::NetParameter read_layers(const cli::NetOptions& options) {
  caffe::NetParameter net =
      proto::read_net(options.prototxt, {.allow_unknown_fields = options.limits.allows("unknown"),
                                         .keep_unread = !options.end.empty(),  // not needed
                                         .types_with_weights = engine::types_with_weights(),
                                         .limits = options.limits.limits()})
          .net;
  cli::set_input_shapes(options.prototxt, options.input_shapes, &net);
  for (caffe::LayerParameter& layer : *net.mutable_layer()) layer.clear_blobs();
  return net;
}

engine::Plan plan_of(const engine::Net& net) {
  return net.plan({}, {.reference_kernels = true,  // which pack no weights
                       .max_run_bytes = std::numeric_limits<int64_t>::max()});
}

/// Throws InputError if a caffemodel cannot hold or assign the weights.
void check_writable(const fs::path& prototxt, const engine::Plan& plan) {
  if (plan.weight_bytes() > std::numeric_limits<int32_t>::max())
    throw InputError(prototxt.string(), ": its weights take ", plan.weight_bytes(),
                     " bytes (a caffemodel holds at most 2^31-1)");
  std::set<std::string> known;
  for (const engine::LayerCost& layer : plan.layers())
    if (!known.insert(layer.name).second && !layer.weights.empty())
      throw InputError(prototxt.string(), ": layer '", layer.name, "' (", layer.type,
                       ") has weights and the name of an earlier layer, to which a caffemodel "
                       "would assign them; rename one");
}

/// Removes the layers that a truncated net does not run.
void truncate(const engine::Net& net, caffe::NetParameter* layers) {
  const engine::Plan plan = plan_of(net);
  std::set<std::string> needed;
  for (const engine::LayerCost& layer : plan.layers()) needed.insert(layer.name);
  auto& list = *layers->mutable_layer();
  list.erase(std::remove_if(list.begin(), list.end(),
                            [&](const auto& layer) { return !needed.contains(layer.name()); }),
             list.end());
}

void add_weights(const engine::Net& net, caffe::NetParameter* layers) {
  int at = 0;
  for (const auto& [layer, blobs] : net.weights()) {
    while (layers->layer(at).name() != layer) ++at;  // both in the order of the file
    for (const auto& blob : blobs) {
      caffe::BlobProto& out = *layers->mutable_layer(at)->add_blobs();
      out.mutable_shape()->mutable_dim()->Add(blob.shape.axes().begin(), blob.shape.axes().end());
      out.mutable_data()->Add(blob.values().begin(), blob.values().end());
    }
    ++at;
  }
}

}  // namespace

ModelFiles write_random_model(const fs::path& folder, const cli::NetOptions& requested) {
  const std::string name = requested.prototxt.stem().string();
  cli::NetOptions options = requested;
  if (!cli::parse_cut(options.end).second.empty())
    throw UsageError("--end: expected one layer, found '", options.end, "'");
  options.prototxt = prototxt_of(requested.prototxt, folder);
  caffe::NetParameter layers = read_layers(options);
  // Before weights are made.
  check_writable(options.prototxt, plan_of(cli::load_net(options, cli::NoWeights::kNone)));
  const engine::Net net =
      engine::Net::load_with_random_weights(options.prototxt, options.seed, options.load_options());
  if (!options.end.empty()) truncate(net, &layers);
  layers.set_name(str(kUntrainedPrefix, name, "_seed_", options.seed));
  make_folder(folder);
  const ModelFiles files{folder / (name + "_random.prototxt"),
                         folder / (name + "_random.caffemodel")};
  proto::write_net_text(files.prototxt, layers);
  add_weights(net, &layers);
  proto::write_net_binary(files.weights, layers);
  return files;
}

bool is_untrained(const std::string& net_name) {
  return net_name.starts_with(kUntrainedPrefix);
}

}  // namespace revisit::models
