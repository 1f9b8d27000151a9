#pragma once

#include <set>
#include <string>
#include <vector>

namespace revisit::engine {

/// A layer type that the engine runs, for people.
struct LayerType {
  std::string type;    // as in the prototxt
  std::string origin;  // "Caffe", or the fork it comes from
  std::string does;
};

/// All of them, sorted by type without regard to case.
std::vector<LayerType> layer_types();

/// Those that have weights, for proto::NetReadOptions.
std::set<std::string> types_with_weights();

}  // namespace revisit::engine
