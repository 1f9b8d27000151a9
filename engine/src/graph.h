#pragma once

#include <memory>
#include <string>
#include <vector>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

using ValueId = int;

/// A tensor that is written once (SSA): an in-place ReLU creates a new value of the same blob.
struct Value {
  std::string blob;
  ValueId memory = -1;  // first value in the memory where Caffe stores this one
};

struct Node {
  std::string name;
  caffe::LayerParameter param;  // its blobs are moved out when weights are loaded
  std::vector<ValueId> inputs, outputs;
  bool is_first_of_name = false;  // among all layers of the net; a weights file refers to this one
  bool in_place = false;  // in the file: an output has the blob name of the input at its position
  int index = -1;         // position of the layer in the file; -1: not in the file
  // Invalid names, which are errors only if the layer is needed:
  std::string dangling = {};     // an input, with id -1, that no earlier layer writes
  std::string overwritten = {};  // an output that another layer has written
  std::shared_ptr<const Layer> layer = nullptr;  // null for Input
  std::vector<Tensor> weights = {};  // without values if the net was loaded without weights
};

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes);

/// Holds nodes in execution order, with resolved blob names.
struct Graph {
  struct Output {
    std::string name;
    ValueId value;
  };
  std::string name;
  std::vector<Node> nodes;
  std::vector<Value> values;
  std::vector<Output> outputs;  // blobs without consumers, in the full net
  std::vector<std::string> warnings;
};

/// Returns whether Caffe stores the tops of a layer in the memory of its first bottom. All of them
/// then show the result of a later in-place layer on any of them.
bool shares_memory(const caffe::LayerParameter& layer);

/// Builds the graph of a net from proto::read_net: TEST phase layers of any type.
Graph parse(const caffe::NetParameter& net);

/// Throws UsageError for unknown layers, with the nearest name, and for invalid grafts; InputError
/// for a needed layer that reads an unwritten blob or writes a blob again.
Graph prune(const Graph& graph, const Truncation& truncation);

}  // namespace revisit::engine
