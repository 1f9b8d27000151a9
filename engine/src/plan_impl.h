#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "dynamic_rows.h"
#include "schedule.h"

namespace revisit::engine {

struct Plan::Impl {
  struct Slot {
    int64_t offset;  // [bytes]
    Shape shape;     // the maximum with dynamic rows
    std::optional<DynamicRows> rows;
  };
  std::shared_ptr<const Net::Impl> net;
  Schedule schedule;  // only steps that run
  std::vector<LayerCost> costs;
  std::vector<Port> inputs, outputs;
  std::map<std::string, Slot, std::less<>> input_slots, output_slots;
  std::map<std::string, Slot, std::less<>> layer_slots;  // kept outputs by port_name()
  bool flush_denormals = true;
  int blas_threads = 0;  // threads that call OpenBLAS concurrently
  int64_t weight_bytes = 0;
};

}  // namespace revisit::engine
