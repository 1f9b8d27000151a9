#pragma once

#include "operations.h"

namespace revisit::engine {

/// The operations of a net after rewrites that leave its outputs as they are, up to rounding:
///   - layers that change nothing (Dropout, Split) are gone,
///   - scale and shift per channel (BatchNorm, Scale, Bias), the sum with another value (Eltwise)
///     and an activation (ReLU, PReLU, ELU, ReLU6) are done by the convolution before them,
///   - normalisation across channels and the maximum pooling after it are one.
/// Values in between are merged away only when nothing else reads them and they are no output.
/// `shapes` are those of the net's values.
Operations fuse(const Net::Impl& net, const std::vector<Shape>& shapes);

/// Makes the convolutions on the only input of the net take one channel that stands for all:
/// channel c is that channel plus `offsets[c]`. Throws UsageError when anything else reads the
/// input.
void fold_gray_input(const Net::Impl& net, const std::vector<Shape>& shapes,
                     const std::vector<float>& offsets, Operations* operations);

}  // namespace revisit::engine
