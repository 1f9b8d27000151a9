#pragma once

#include "operations.h"

namespace revisit::engine {

/// A value as it lies in memory. One value can be stored in both layouts.
struct Stored {
  ValueId value;
  Layout layout;
  Shape shape;  // of the value; one channel for a gray input
  int64_t bytes;
  bool pinned = false;  // read or written from outside: keeps its numbers to the end
  int64_t offset = 0;   // [bytes] from the start of the arena; place() sets it
};

/// A kernel with its operands: indices into Schedule::stored.
struct Step {
  size_t layer;  // it counts for: index into Graph::nodes
  Kernel kernel;
  OutputMemory memory = OutputMemory::kOwn;  // kViewOfInput: nothing runs
  std::vector<size_t> inputs, outputs;
  bool is_reorder = false;
  KernelReason why = KernelReason::kNone;  // LayerCost::why
  // place() sets these:
  bool runs = true;                // false where nothing has to be done
  int64_t scratch = 0, state = 0;  // [bytes] from the start of the arena
  int64_t new_bytes = 0;           // memory that its outputs take anew
  HeldWeights weights = {};        // what Kernel::hold gave
};

/// All kernels of a forward pass in order, with the reorders between layouts.
struct Schedule {
  std::vector<Stored> stored;
  std::vector<Step> steps;
  std::vector<size_t> inputs;               // of the net, in the order of its Input layers
  std::vector<std::optional<size_t>> nchw;  // of each value: where it lies in plain layout
  int64_t packed_bytes = 0;                 // of all kernels
  // place() sets these:
  std::vector<BufferUse> buffers;  // for people
  int64_t arena_bytes = 0;
};

/// Binds every operation: blocked kernels where a layer has one that takes what is there, with
/// reorders only where a layout is missing. Values that are read from outside (the outputs of the
/// net; all, with keep_all) are plain in the end. Nothing is packed yet; unless kernels `may_pack`,
/// all read the weights as they are. Throws InputError naming the layer that refuses the shapes.
Schedule schedule(const Net::Impl& net, const std::vector<Shape>& shapes,
                  const Operations& operations, const PlanOptions& options, bool may_pack);

}  // namespace revisit::engine
