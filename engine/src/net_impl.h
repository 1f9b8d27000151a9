#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "layer.h"
#include "revisit/engine/net.h"
#include "revisit/proto/net_file.h"
#include "revisit/proto/weights_file.h"
#include "weight_cache.h"

namespace revisit::engine {

using proto::Value;
using proto::ValueId;

/// A node of the resolved net with its parameters, its weights, and the layer that runs it.
struct Node : proto::Node {
  caffe::LayerParameter param;    // its blobs are moved out when weights are loaded
  bool is_first_of_name = false;  // among all layers of the net; a weights file refers to this one
  std::shared_ptr<const Layer> layer = nullptr;  // null for Input
  /// Shared with parts of the net. Without values if the net was loaded without weights.
  std::shared_ptr<std::vector<Tensor>> weights = std::make_shared<std::vector<Tensor>>();
};

/// Like proto::Graph, with the nodes that remain of the net.
struct Graph {
  std::string name;
  std::vector<Node> nodes;
  std::vector<Value> values;
  std::vector<std::pair<std::string, ValueId>> outputs;
};

/// (layer name, blob index) -> parameter name, for blobs shared by `param { name }`. For layers
/// with the same name, the first one counts.
using Sharing = std::map<std::pair<std::string, size_t>, std::string>;

/// Parameter name -> its values in the prototxt, in a layer with only a name and blobs. As in
/// Caffe, only the first layer with a parameter can define them.
using OwnShared = std::map<std::string, caffe::LayerParameter>;

struct Net::Impl {
  std::string file;                  // path of the prototxt for messages
  Graph graph;                       // pruned
  std::vector<bool> sensitive;       // per value: see sensitive_values()
  std::set<ValueId> blocked_inputs;  // of a part: stored by channel blocks in the whole net
  std::vector<Port> inputs;
  std::vector<std::string> layer_names;  // full net
  Sharing sharing;                       // full net
  OwnShared own_shared;                  // full net
  std::vector<std::string> warnings;
  uint64_t weight_bytes_read = 0;
  bool has_weights = false;
  mutable WeightCache packed_weights;
};

/// Infers the shapes of all values; empty for values of pruned nodes. `inputs` overrides shapes of
/// Input layers by blob name. Throws InputError with the layer.
std::vector<Shape> infer_shapes(const Net::Impl& net, const std::map<std::string, Shape>& inputs);

/// "FILE: layer 'NAME' (TYPE)".
std::string place_of(const std::string& file, const Node& node);

/// Does `work`; its InputError or UnsupportedError gets file and layer in front of its message.
void at_layer(const std::string& file, const Node& node, const std::function<void()>& work);

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes);

/// Returns the parameter name of a blob of `node`; "" if it cannot be shared.
std::string parameter_of(const Node& node, size_t blob);

/// Finds shared blobs (`param { name: "..." }`) over all layers of the file.
Sharing find_sharing(const caffe::NetParameter& file);

OwnShared find_own_shared(const caffe::NetParameter& file);

bool has_own_weights(const Net::Impl& net);

/// Throws InputError unless shared blobs of kept layers have equal shapes, or equal numbers of
/// elements with `share_mode: PERMISSIVE`.
void check_sharing(const Net::Impl& net);

/// Sets weights from the prototxt itself, then from the file, if any. The file's layers match by
/// name over all layers of the net, as in Caffe (docs/reference/LAYERS.md point 9). Shared blobs
/// take the weights of any layer of their group. Throws InputError with layer, blob, expected and
/// found shapes, and for missing weights unless allowed.
void load_weights(Net::Impl& net, std::unique_ptr<proto::WeightsFile> weights,
                  const LoadOptions& options);

/// Values of weight blob `blob` of a layer before training, as Caffe's fillers define them; random
/// ones differ from Caffe's. Throws InputError for an unknown filler.
std::vector<float> initial_weights(const caffe::LayerParameter& layer, size_t blob,
                                   const Shape& shape, uint64_t seed);

/// Draws weights from Gaussians with mean 0 and variance 2 / (inputs per output) (He et al. 2015),
/// so that values keep their size from layer to layer. Biases are uniform in [-0.01, 0.01), factors
/// and variances in [0.9, 1.1).
///
/// Value i of blob b of the file's layer l depends only on (seed, l, b, i), by the finalizer of
/// SplitMix64 (Steele et al. 2014). A Gaussian is the sum of 12 uniform 32-bit integers
/// (Irwin-Hall: variance exactly 1, support +-6) without libm, so the bits are the same everywhere.
void fill_randomly(Net::Impl& net, uint64_t seed);

}  // namespace revisit::engine
