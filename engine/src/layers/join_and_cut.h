#pragma once

#include "layer.h"

/// Kernels that join and cut along an axis, on values of any layout.
namespace revisit::engine {

/// Copies the inputs one after another, `outer` times: of each, as many floats as `sizes` says.
Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes);

/// The reverse: copies to each output its part of the input.
Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads);

}  // namespace revisit::engine
