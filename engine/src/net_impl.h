#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "graph.h"
#include "revisit/engine/net.h"
#include "weight_cache.h"

namespace revisit::engine {

/// (layer name, blob index) -> name of the parameter, for blobs that `param { name }` shares; of
/// layers that share a name, those of the first.
using Sharing = std::map<std::pair<std::string, size_t>, std::string>;

/// Name of a parameter -> its values in the prototxt, in a layer that has only a name and them. As
/// in Caffe only the first layer with a parameter can say them.
using OwnShared = std::map<std::string, caffe::LayerParameter>;

struct Net::Impl {
  std::string file;  // the prototxt, for messages
  Graph graph;       // pruned
  std::vector<Port> inputs;
  std::vector<std::string> layer_names;  // of the whole net
  Sharing sharing;                       // of the whole net
  OwnShared own_shared;                  // of the whole net
  std::vector<std::string> warnings;
  uint64_t weight_bytes_read = 0;
  bool has_weights = false;
  mutable WeightCache packed_weights;  // filled by plans
};

/// Shapes of all values of a graph; empty shapes for values of pruned nodes.
/// `inputs` replaces the shapes of Input layers by blob name. Throws InputError naming the layer.
std::vector<Shape> infer_shapes(const Net::Impl& net, const std::map<std::string, Shape>& inputs);

/// Rethrows the error being handled, with the place in front of its message.
[[noreturn]] void rethrow_at(const std::string& file, const Node& node);

}  // namespace revisit::engine
