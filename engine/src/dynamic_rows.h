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
/// Plans are made for the most rows. Such a value can be an output of the net, be seen through
/// views, or be read by layers that work on each of its items alone (Layer::keeps_items()): these
/// compute all rows, and those beyond the number are cut off. Throws UnsupportedError, naming the
/// layer, for any other reader.
std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes);

/// The kernel of a layer whose rows (axis 0) depend on the data, with zeros in the rows that it
/// leaves out: their readers compute with them.
Kernel with_zero_rest(Kernel kernel, const std::vector<Shape>& outputs);

}  // namespace revisit::engine
