#pragma once

#include <cstdint>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::profiling {

/// Bandwidth for a working set of `bytes`, all threads together, each on its own part [GB/s].
struct Bandwidth {
  int64_t bytes = 0;
  double read = 0;
  double copy = 0;  // bytes read plus bytes written
};

/// Limits of this machine with some number of threads: compute and bandwidth of the roofline model
/// (Williams, Waterman and Patterson, 2009).
struct SpeedLimits {
  int threads = 1;
  double float32_gflops = 0;  // a multiply-add counts as two operations
  double bf16_gflops = 0;     // 0 without bfloat16 instructions
  /// From a working set in a core's caches to one beyond all caches, ascending.
  std::vector<Bandwidth> bandwidths;

  /// DRAM bandwidth: working set beyond all caches.
  const Bandwidth& memory() const { return bandwidths.back(); }

  /// Lower bound for a layer's multiplications, without padding and additions [ms].
  double compute_ms(const engine::LayerCost& cost) const;
  /// Lower bound for reading and writing its data once, from the fastest cache that holds it [ms].
  double traffic_ms(const engine::LayerCost& cost) const;
};

/// Measures the limits in about half a second by many short runs, with up to 256 MB. Other running
/// programs lower the results. Throws UsageError for threads outside 1 to 1024, std::bad_alloc.
SpeedLimits measure_speed_limits(int threads);

}  // namespace revisit::profiling
