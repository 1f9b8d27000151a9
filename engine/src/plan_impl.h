#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "dynamic_rows.h"
#include "layer.h"
#include "net_impl.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// One kernel to run and where its operands are, in floats from the start of the arena.
struct Step {
  size_t layer;  // index into Plan::layers()
  Kernel kernel;
  std::vector<int64_t> inputs, outputs;
  int64_t scratch = 0;
  int64_t state = 0;
  HeldWeights weights = {};  // Kernel::hold
};

struct Plan::Impl {
  /// A value that is readable from outside.
  struct Slot {
    int64_t offset;  // floats
    Shape shape;     // with dynamic rows: the largest
    std::optional<DynamicRows> rows;
  };
  std::shared_ptr<const Net::Impl> net;
  std::vector<Step> steps;
  std::vector<LayerCost> costs;
  std::vector<BufferUse> buffers;
  std::vector<Port> inputs, outputs;
  std::map<std::string, Slot, std::less<>> input_slots, output_slots;
  std::map<std::string, Slot, std::less<>> layer_slots;  // by port_name(), with keep_all
  bool flush_denormals = true;
  int blas_threads = 0;  // that multiply by OpenBLAS at the same time
  int64_t arena_floats = 0;
  int64_t weight_floats = 0;
  int64_t packed_floats = 0;
};

}  // namespace revisit::engine
