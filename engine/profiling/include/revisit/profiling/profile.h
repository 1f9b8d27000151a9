#pragma once

#include <functional>
#include <vector>

#include "revisit/engine/net.h"

namespace revisit::profiling {

/// Of repeated timings [ms].
struct Timing {
  double min = 0, median = 0, p95 = 0;
  /// The median of all passes that could have been made is between these with 99 % confidence, as
  /// far as passes do not depend on each other. Of fewer than kLeastForBounds they are the least
  /// and the largest sample.
  double low = 0, high = 0;
};

/// So many samples, and all on one side of the median, happen once in a hundred times.
constexpr int kLeastForBounds = 8;

/// Order statistics; p95 is the nearest-rank 95th percentile. `samples` must not be empty.
Timing summarize(std::vector<double> samples_ms);

struct ProfileOptions {
  int warmup = 2;
  int repeat = 20;
  /// Polled between passes; true ends the measurement with the passes made (at least one).
  std::function<bool()> stop;
};

/// Cost of each layer and of the whole.
struct Profile {
  std::vector<Timing> layers;  // as Plan::layers(), from instrumented passes
  Timing layer_sum;            // the sum of the layers, pass by pass
  Timing total;                // of uninstrumented passes
  int passes = 0;
};

/// Times forward passes of `run` as it stands (inputs are not changed). Instrumented and
/// uninstrumented passes alternate, so that a drifting machine touches both alike.
Profile profile(engine::Run& run, const ProfileOptions& options = {});

}  // namespace revisit::profiling
