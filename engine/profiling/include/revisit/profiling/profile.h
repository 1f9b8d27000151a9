#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::profiling {

/// Statistics of repeated timings [ms].
struct Timing {
  double min = 0, median = 0, p95 = 0;  ///< p95: nearest-rank 95th percentile
  /// 99 % confidence interval of the population median, if passes are independent. With fewer than
  /// kMinSamplesForInterval samples: minimum and maximum.
  double low = 0, high = 0;
  double confidence = 0;  ///< of [low, high]: 0.75 for 3 samples, 0 for one
};

/// Minimum number of samples for the interval: the chance that all are on one side of the median is
/// then below 1 %.
constexpr int kMinSamplesForInterval = 8;

/// `samples_ms` must not be empty.
Timing summarize(std::vector<double> samples_ms);

constexpr int kWarmup = 2, kRepeat = 20;  ///< default numbers of passes

/// Times of each layer and of full passes.
struct Profile {
  std::vector<Timing> layers;  ///< as Plan::layers(), from instrumented passes
  Timing layer_sum;            ///< sum over the layers of each instrumented pass
  Timing total;                ///< uninstrumented passes
  int passes = 0;              ///< timed passes of each kind
};

/// Times forward passes of `run` with its current inputs. Instrumented and uninstrumented passes
/// alternate, so that clock drift affects both equally. `stop` is polled between passes; true ends
/// the measurement after at least one pass.
Profile profile(engine::Run& run, int warmup = kWarmup, int repeat = kRepeat,
                const std::function<bool()>& stop = {});

/// Bandwidth for a working set of `bytes`, all threads together, each on its own part [GB/s].
struct Bandwidth {
  int64_t bytes = 0;  ///< size of the working set
  double read = 0;    ///< [GB/s]
  double copy = 0;    ///< bytes read plus bytes written [GB/s]
};

/// Limits of this machine with some number of threads: compute and bandwidth of the roofline model
/// (Williams, Waterman and Patterson, 2009).
struct SpeedLimits {
  int threads = 1;            ///< used for the measurement
  double float32_gflops = 0;  ///< a multiply-add counts as two operations
  double bf16_gflops = 0;     ///< 0 without bfloat16 instructions
  /// From a working set in a core's caches to one beyond all caches, ascending.
  std::vector<Bandwidth> bandwidths;

  /// Lower bound for a layer's multiplications, without padding and additions [ms].
  double compute_ms(const engine::LayerCost& cost) const;
  /// Lower bound for reading and writing its data once, from the fastest cache that holds it [ms].
  double traffic_ms(const engine::LayerCost& cost) const;
};

/// Measures the limits in about half a second by many short runs, with up to 256 MB. Other running
/// programs lower the results. Throws UsageError for threads outside 1 to 1024, std::bad_alloc.
SpeedLimits measure_speed_limits(int threads);

}  // namespace revisit::profiling
