#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "revisit/evaluation/precision_recall.h"

namespace revisit::pipeline {

/// The percentile bootstrap (Efron 1979): as many queries as there are, drawn with replacement.
struct BootstrapOptions {
  int resamples = 1000;
  double confidence = 0.95;
  uint64_t seed = 1;
  int threads = 1;             // the result is the same for any number
  std::function<bool()> stop;  // true: throw Interrupted
};

struct Interval {
  double low = 0, high = 0;  // NaN: not computed
};

struct PrIntervals {
  Interval f1_max, average_precision, recall_at_1, max_recall_at_precision_1, extended_precision;
};

/// Intervals over the queries; resamples without a positive are left out. Queries of a drive are
/// not independent, so the intervals are too narrow for another drive.
///
///   auto ci = bootstrap(verdicts, task.missed, {.resamples = 1000});
///   ci.average_precision.low;
///
/// Throws UsageError for less than 1 resample or thread or a confidence outside (0, 1).
PrIntervals bootstrap(const std::vector<Verdict>& verdicts, Missed missed = Missed::kNotFound,
                      const BootstrapOptions& options = {});

}  // namespace revisit::pipeline
