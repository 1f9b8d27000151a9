#pragma once

#include <set>
#include <string>
#include <vector>

namespace revisit::engine {

struct LayerType {
  std::string type;    // as in the prototxt
  std::string origin;  // "Caffe", or the fork it comes from
  std::string does;
};

/// Sorted case-insensitively.
std::vector<LayerType> layer_types();

/// Types with weights, for proto::NetReadOptions.
std::set<std::string> types_with_weights();

}  // namespace revisit::engine
