#pragma once

#include "kernels/nchw.h"
#include "layer.h"

/// Kernels that copy. Joining and cutting along an axis support values of any layout.
namespace revisit::engine {

Kernel copy_kernel(const char* name, StridedCopyProblem copy);

/// Concatenates the inputs `outer` times; `sizes` has the floats of each.
Kernel join_kernel(int64_t outer, const std::vector<int64_t>& sizes);

/// Inverse of join_kernel().
Kernel cut_kernel(int64_t outer, const std::vector<int64_t>& sizes, int threads);

}  // namespace revisit::engine
