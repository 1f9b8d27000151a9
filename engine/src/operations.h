#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "kernels/blocked/kernels.h"
#include "net_impl.h"

namespace revisit::engine {

/// A unit of execution: a layer with the layers fused into it.
struct Operation {
  size_t node;                   // main layer: index into Graph::nodes
  std::vector<size_t> absorbed;  // fused layers
  std::reference_wrapper<const Layer> layer;
  Form form;
  std::vector<ValueId> inputs, outputs;
  Fusion fusion = {};
  int max_winograd_points = kAnyPoints;
  /// Kernel of a convolution, set if a fusion requires it; null: chosen at scheduling.
  const BlockedConvolutionKernel* convolution = nullptr;
};

/// Layers of a net as operations, in execution order, without Input layers.
struct Operations {
  std::vector<Operation> list;
  /// Per value: the value that stores its numbers, which is itself unless its layer is an identity.
  std::vector<ValueId> held_by;
  /// Per value: true for outputs of the net and kept values, which must not be overwritten.
  std::vector<bool> read_outside;
  std::optional<ValueId> gray_input;  // input with a single channel in memory that represents all
};

/// Makes one operation per layer, without fusion; drops identities (Dropout, Split). `shapes` are
/// those of all values; `kept` values are read from outside in addition to the net's outputs.
Operations operations_of(const Net::Impl& net, const std::vector<Shape>& shapes,
                         const std::vector<ValueId>& kept = {});

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
