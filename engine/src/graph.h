#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "layer.h"
#include "revisit/proto/net_file.h"

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

std::vector<Shape> shapes_of(const std::vector<ValueId>& ids, const std::vector<Shape>& shapes);

}  // namespace revisit::engine
