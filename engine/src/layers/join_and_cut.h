#pragma once

#include "kernels/strided_copy.h"
#include "layer.h"

/// Kernels that copy. Those that join and cut along an axis take values of any layout.
namespace revisit::engine {

/// A strided_copy() of the only input.
Kernel copy_kernel(const char* name, StridedCopyProblem copy);

/// Copies the inputs one after another, `outer` times: of each, as many floats as `sizes` says.
Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes);

/// The reverse: copies to each output its part of the input.
Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads);

}  // namespace revisit::engine
