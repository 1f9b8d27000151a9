#pragma once

#include <optional>
#include <vector>

#include "net_impl.h"

namespace revisit::engine {

/// How the shape of a value follows the number of rows that a layer found at run time.
struct DynamicRows {
  size_t layer;      // the layer that counts the rows: index into Graph::nodes
  size_t axis;       // of the value
  int64_t multiple;  // size of that axis for each row: views can fold other axes into it
};

/// For every value of the net, how its size depends on the data; nothing for values of fixed size.
/// Such a value can be an output of the net or be seen through views. Plans are made for fixed
/// sizes: throws UnsupportedError, naming the layer, when one is computed on.
std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes);

}  // namespace revisit::engine
