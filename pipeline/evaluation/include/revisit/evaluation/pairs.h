#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "revisit/evaluation/bootstrap.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/evaluation/protocols.h"

namespace revisit::pipeline {

struct PairOptions {
  int threads = 1;                            // the result is the same for any number
  std::optional<BootstrapOptions> bootstrap;  // absent: no intervals
  std::function<void(int64_t done, int64_t total)> progress;  // in queries
  std::function<bool()> stop;                                 // true: throw Interrupted
};

/// How many scores fall where: bin i is [low + i width, low + (i + 1) width).
struct ScoreHistogram {
  static constexpr int kBins = 60;
  double low = 0, width = 0;
  std::array<int64_t, kBins> of_true{}, of_false{};
};

struct PairResult {
  PrSummary summary;
  std::optional<PrIntervals> intervals;  // of queries, each with all of its pairs
  BlockCounts blocks;                    // of these queries, resampled
  std::vector<PrPoint> curve;            // as precision_recall(), thinned to about 1000 points
  ScoreHistogram histogram;
};

/// Evaluates a task that accepts a pair of a query and a candidate from a similarity threshold on.
///
/// A pair nearer than the rule's radius is true beyond the task's exclusion, else not counted.
/// `negatives_per_positive` false ones are drawn at random, the same in every run. Similarities are
/// compared as floats: 82 MB for all pairs of 4541 scans. Candidates that keys leave out have the
/// similarity -1. Only the descriptors of alignment case 1 are compared.
///
///   auto task = make_tasks("ssc", "00", trajectory).at(0);
///   auto result = evaluate_pairs(task, trajectory, descriptors);
///   result.summary.f1_max;
///
/// Throws UsageError when the trajectory has no positions (or places) or there are more than 2^27
/// pairs to compare, Error when a descriptor or a similarity is not finite, the descriptors are not
/// those of the trajectory, or the task decides on queries.
PairResult evaluate_pairs(const Task& task, const Trajectory& trajectory,
                          const Descriptors& descriptors, const PairOptions& options = {});

}  // namespace revisit::pipeline
