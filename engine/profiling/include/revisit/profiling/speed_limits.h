#pragma once

#include <cstdint>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::profiling {

/// How fast a working set of `bytes` is moved, all threads together, each its own part [GB/s].
struct Bandwidth {
  int64_t bytes = 0;
  double read = 0;
  double copy = 0;  // counts what is read and what is written
};

/// What this machine can do at most on some threads at once: the two roofs over every kernel
/// (Williams, Waterman and Patterson: Roofline, 2009).
struct SpeedLimits {
  int threads = 1;
  double float32_gflops = 0;  // a multiplication and an addition are two operations
  double bf16_gflops = 0;     // 0 without instructions for them
  /// From what fits the caches of a core to what fits no cache, ascending.
  std::vector<Bandwidth> bandwidths;

  /// Of memory, beyond all caches.
  const Bandwidth& memory() const { return bandwidths.back(); }

  /// The least time for a layer's multiplications, without padding and additions [ms].
  double compute_ms(const engine::LayerCost& cost) const;
  /// The least time to read and write its data once, when all lies as near as it can [ms].
  double traffic_ms(const engine::LayerCost& cost) const;
};

/// Measures them in about half a second, by many short runs, with up to 256 MB. Other programs make
/// them too low. Throws UsageError for threads outside 1 to 1024, std::bad_alloc.
SpeedLimits measure_speed_limits(int threads);

}  // namespace revisit::profiling
