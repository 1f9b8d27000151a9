#pragma once

#include "layer.h"
#include "operations.h"

namespace revisit::engine {

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
  HeldWeights weights = {};
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

}  // namespace revisit::engine
