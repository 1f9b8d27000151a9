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

/// A value in memory. One value can be stored in both layouts.
struct Stored {
  ValueId value;
  Layout layout;
  Shape shape;  // value's shape; a single-channel input has one channel
  int64_t bytes;
  bool pinned = false;  // accessed from outside: must not be overwritten
  int64_t offset = 0;   // [bytes] in the arena; set by place()
};

/// A kernel with its operands, which are indices into Schedule::stored.
struct Step {
  size_t layer;  // index into Graph::nodes
  Kernel kernel;
  OutputMemory memory = OutputMemory::kOwn;  // kViewOfInput: nothing runs
  std::vector<size_t> inputs, outputs;
  bool is_reorder = false;
  const char* selection_reason = "";  // LayerCost::selection_reason
  // Set by place():
  bool runs = true;
  int64_t scratch = 0, state = 0;  // [bytes] in the arena
  int64_t new_bytes = 0;           // memory of outputs that is not shared
  std::shared_ptr<const PackedWeights> weights = {};
};

struct Schedule {
  std::vector<Stored> stored;
  std::vector<Step> steps;
  std::vector<size_t> inputs;               // net inputs, in the order of its Input layers
  std::vector<std::optional<size_t>> nchw;  // per value: stored value in NCHW layout
  int64_t packed_bytes = 0;
  // Set by place():
  std::vector<BufferUse> buffers;
  int64_t arena_bytes = 0;
};

/// Binds every operation, with NCHWc kernels where a layer supports the available layouts, and
/// reorders only where a layout is missing. Values read from outside (outputs of the net, kept
/// values) are also stored in NCHW. Packs no weights; unless kernels `may_pack`, all use unpacked
/// weights. Throws InputError with the layer that rejects the shapes.
Schedule schedule(const Net::Impl& net, const std::vector<Shape>& shapes,
                  const Operations& operations, const PlanOptions& options, bool may_pack);

/// Binds the kernel of a layer with its fused operations. Only this function selects NCHWc kernels:
/// if an input is NCHWc and `form` describes the layer completely. Otherwise it uses the layer's.
Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding);

/// Places values in the arena. They can share buffers (views, in-place outputs, inputs of a Concat
/// in its output), also over time. Pinned values are never overwritten.
void place(const Net::Impl& net, Schedule* schedule);

/// A buffer of `size` that is live from step `first` to step `last`, inclusive.
struct Lifetime {
  int64_t size = 0;
  int first = 0, last = 0;
};

struct MemoryPlan {
  std::vector<int64_t> offsets;
  int64_t total = 0;
};

/// Places buffers in an arena so that buffers with overlapping lifetimes do not overlap. Places the
/// largest first, each into the lowest sufficient gap. If there are very many, places the smaller
/// ones step by step above these. Offsets are multiples of `alignment`; 0 for empty buffers.
MemoryPlan plan_memory(const std::vector<Lifetime>& buffers, int64_t alignment);

}  // namespace revisit::engine
