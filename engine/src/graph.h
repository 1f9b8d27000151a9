#pragma once

#include <memory>
#include <string>
#include <vector>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// Index into Graph::values.
using ValueId = int;

/// A tensor written once (SSA): an in-place ReLU makes a new value under the same blob name.
struct Value {
  std::string blob;
  ValueId memory = -1;  // the value that was the first in the memory that Caffe has this one in
};

/// A layer of the file.
struct Node {
  std::string name;
  caffe::LayerParameter param;  // its blobs are taken when weights are loaded
  std::vector<ValueId> inputs, outputs;
  bool is_first_of_name =
      false;              // of the layers of the whole net: the one that a weights file means
  bool in_place = false;  // in the file: an output has the blob name of the input at its position
  int index = -1;         // of the layer in the file; -1: it has no such layer
  // Names that mean nothing, of which nobody needs to know who does not need the layer:
  std::string dangling = {};     // an input, of id -1, that no layer before it writes
  std::string overwritten = {};  // an output that another layer has written
  // From here on set when the net is loaded, for layers that are needed:
  std::shared_ptr<const Layer> layer = nullptr;  // null for Input
  std::vector<Tensor> weights = {};  // values are empty when the net was loaded without weights
};

/// Of these values, `shapes` being those of all.
std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes);

/// What a prototxt says, names resolved. Nodes are in execution order.
struct Graph {
  struct Output {
    std::string name;
    ValueId value;
  };
  std::string name;
  std::vector<Node> nodes;
  std::vector<Value> values;
  std::vector<Output> outputs;        // of the whole graph: the blobs nobody consumes
  std::vector<std::string> warnings;  // of prune: for the user
};

/// Whether Caffe has the tops of a layer in the memory of its first bottom: all show the result of
/// a later layer in place on any of them.
bool shares_memory(const caffe::LayerParameter& layer);

/// Builds the graph of a net that proto::read_net gave: the layers of the TEST phase only, of any
/// type.
Graph parse(const caffe::NetParameter& net);

/// Keeps what `truncation` needs, with the grafted layer appended. Throws UsageError for layers
/// that are not there, naming the nearest, and for layers that cannot be grafted or grafted onto;
/// InputError for a layer that is needed and reads what nobody writes, or writes a blob again.
Graph prune(const Graph& graph, const Truncation& truncation);

}  // namespace revisit::engine
