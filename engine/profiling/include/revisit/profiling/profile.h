#pragma once

#include <functional>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::profiling {

/// Statistics of repeated timings [ms].
struct Timing {
  double min = 0, median = 0, p95 = 0;
  /// 99 % confidence interval of the population median, if passes are independent. With fewer than
  /// kMinSamplesForInterval samples: minimum and maximum.
  double low = 0, high = 0;
};

/// Minimum number of samples for the interval: the chance that all are on one side of the median is
/// then below 1 %.
constexpr int kMinSamplesForInterval = 8;

/// p95 is the nearest-rank 95th percentile. `samples_ms` must not be empty.
Timing summarize(std::vector<double> samples_ms);

struct ProfileOptions {
  int warmup = 2;
  int repeat = 20;
  /// Polled between passes; true ends the measurement after at least one pass.
  std::function<bool()> stop;
};

struct Profile {
  std::vector<Timing> layers;  // as Plan::layers(), from instrumented passes
  Timing layer_sum;
  Timing total;  // uninstrumented passes
  int passes = 0;
};

/// Times forward passes of `run` with its current inputs. Instrumented and uninstrumented passes
/// alternate, so that clock drift affects both equally.
Profile profile(engine::Run& run, const ProfileOptions& options = {});

}  // namespace revisit::profiling
