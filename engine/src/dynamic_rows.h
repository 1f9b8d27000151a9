#pragma once

#include <optional>
#include <vector>

#include "net_impl.h"

namespace revisit::engine {

/// Dependence of a value's shape on a number of rows that a layer determines at run time.
struct DynamicRows {
  size_t layer;  // index into Graph::nodes
  size_t axis;
  int64_t multiple;  // size of that axis per row, because views can merge other axes into it
};

/// Returns the dependence for each value of the net; nullopt for values of fixed size. Plans are
/// made for the maximum number of rows. Such a value can be an output of the net, pass through
/// views, or be read by layers that process items independently (Layer::keeps_items()). These
/// compute all rows; superfluous ones are cut off. Throws UnsupportedError with the layer for any
/// other reader.
std::vector<std::optional<DynamicRows>> dynamic_rows(const Net::Impl& net,
                                                     const std::vector<Shape>& shapes);

/// Fills rows (axis 0) that `kernel` does not write with zeros, because readers use them.
Kernel with_zero_rest(Kernel kernel, const std::vector<Shape>& outputs);

}  // namespace revisit::engine
