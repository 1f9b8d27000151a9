#pragma once

#include "operations.h"

namespace revisit::engine {

/// Fuses operations; the outputs of the net are equal up to rounding:
///   - scale and shift per channel (BatchNorm, Scale, Bias) are folded into the weights of the
///   preceding convolution, or into each other,
///   - the sum with another value (Eltwise) is fused into the convolution that computes the later
///   input,
///   - activations (ReLU, PReLU, ELU, ReLU6) are fused into the operation before them,
///   - LRN across channels and the following maximum pooling become one operation, and both (or
///   pooling alone) are fused into the net's first convolution.
/// A value in between is removed only if it has no other reader inside or outside the net. The last
/// fusion needs a kernel with packed weights, so only if kernels `may_pack`.
Operations fuse(Operations operations, bool may_pack);

/// Returns for each value whether a later layer amplifies its rounding.
std::vector<bool> sensitive_values(const Graph& graph);

/// Sets Operation::max_winograd_points: for all operations if `strict`, else for those
/// with `sensitive` outputs. Must be called before fuse().
void limit_rounding(bool strict, const std::vector<bool>& sensitive, Operations* operations);

/// Makes convolutions on the net's only input read one channel x; channel c is x + `offsets[c]`.
/// Must be called before fuse(). Throws UsageError if any other layer reads the input.
void fold_single_channel_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                               const std::vector<float>& offsets, Operations* operations);

}  // namespace revisit::engine
