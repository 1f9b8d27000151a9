#pragma once

#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "graph.h"
#include "revisit/engine/net.h"
#include "weight_cache.h"

namespace revisit::engine {

/// (layer name, blob index) -> parameter name, for blobs shared by `param { name }`. For layers
/// with the same name, the first one counts.
using Sharing = std::map<std::pair<std::string, size_t>, std::string>;

/// Parameter name -> its values in the prototxt, in a layer with only a name and blobs. As in
/// Caffe, only the first layer with a parameter can define them.
using OwnShared = std::map<std::string, caffe::LayerParameter>;

struct Net::Impl {
  std::string file;             // path of the prototxt for messages
  Graph graph;                  // pruned
  std::vector<bool> sensitive;  // per value: see sensitive_values()
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

/// Rethrows the current exception with file and layer in front of its message.
[[noreturn]] void rethrow_at(const std::string& file, const Node& node);

}  // namespace revisit::engine
