#pragma once

#include <string>
#include <vector>

#include "caffe_schema.pb.h"

/// Which value a blob name means: the only place that resolves names, in-place layers and blobs
/// that share memory in Caffe.
namespace revisit::proto {

using ValueId = int;

/// A tensor that is written once (SSA): an in-place ReLU creates a new value of the same blob.
struct Value {
  std::string blob;
  ValueId memory = -1;  // first value in the memory where Caffe stores this one
};

/// A layer of the file, or an inserted Split with two inputs: it shows the first, which an in-place
/// layer wrote, in the shape of the second, which shares its memory.
struct Node {
  std::string name, type;
  int index = -1;  // position of the layer in the file; -1: inserted
  std::vector<ValueId> inputs, outputs;
  bool in_place = false;  // in the file: an output has the blob name of the input at its position
  // Invalid names, which are errors only if the layer is needed:
  std::string dangling = {};     // an input, with id -1, that no earlier layer writes
  std::string overwritten = {};  // an output that another layer has written
};

/// Nodes in execution order.
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

/// Resolves the blob names of a net from read_net(), for layers of any type.
Graph resolve(const caffe::NetParameter& net);

/// Keeps what the outputs of the layer `end` need, or the net's outputs if `end` is empty. `graft`,
/// if not empty, is appended: a copy of this layer, named "end+graft", after the in-place layers,
/// BatchNorm, Scale and ReLU of `end`. Throws UsageError for unknown layers, with the nearest name,
/// and for invalid grafts; InputError for a needed layer that reads an unwritten blob or writes a
/// blob again.
Graph prune(const Graph& graph, const std::string& end, const std::string& graft);

/// Returns the name of output `port` of a layer: "slice", "slice.1", "slice.2", ...
std::string port_name(const std::string& layer, size_t port);

}  // namespace revisit::proto
