#pragma once

#include "operations.h"

namespace revisit::engine {

/// Rewrites that leave the outputs of a net as they are, up to rounding:
///   - scale and shift per channel (BatchNorm, Scale, Bias) go into the weights of the convolution
///     before them, or into one another,
///   - the sum with another value (Eltwise) is added by the convolution that makes the later input,
///   - activations (ReLU, PReLU, ELU, ReLU6) are done by the operation before them,
///   - normalisation across channels and the maximum pooling after it are one operation, and both
///     (or pooling alone) one with the net's first convolution.
/// Values in between are merged away only when nothing else reads them, inside or outside.
/// The last needs a kernel that packs weights: only where kernels `may_pack`.
Operations fuse(Operations operations, bool may_pack);

/// Sets Operation::most_winograd_points: of all operations when `accuracy` is strict, else of those
/// whose values reach a layer that amplifies rounding. To be called before fuse().
void limit_rounding(Accuracy accuracy, Operations* operations);

/// Makes the convolutions on the only input of the net take one channel for all: channel c is that
/// channel plus `offsets[c]`. Before fuse(). Throws UsageError when anything else reads the input.
void fold_gray_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                     const std::vector<float>& offsets, Operations* operations);

}  // namespace revisit::engine
