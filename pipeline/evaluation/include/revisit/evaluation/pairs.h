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

namespace revisit {

struct PairOptions {
  int threads = 1;  // does not affect the result
  std::optional<BootstrapOptions> bootstrap;
  std::function<void(int64_t done, int64_t total)> progress;  // in queries
  std::function<bool()> stop;                                 // true: throw Interrupted
};

/// Histogram of scores: bin i is [low + i width, low + (i + 1) width).
struct ScoreHistogram {
  static constexpr int kBins = 60;
  double low = 0, width = 0;
  std::array<int64_t, kBins> of_true{}, of_false{};
};

struct PairResult {
  PrSummary summary;
  std::optional<PrIntervals> intervals;  // resampled over queries, each with all of its pairs
  BlockCounts blocks;
  std::vector<PrPoint> curve;  // like precision_recall(), thinned to about 1000 points
  ScoreHistogram histogram;
};

/// Evaluates a task that accepts pairs of a query and a candidate by a similarity threshold. A pair
/// nearer than the rule's radius is true if it is outside the task's exclusion, else ignored.
/// `negatives_per_positive` false pairs are drawn at random with a fixed seed. Similarities are
/// compared as floats: 82 MB for all pairs of 4541 scans. Candidates that compact codes exclude
/// have similarity -1. Only the descriptors of alignment case 1 are compared.
///
/// Throws UsageError if the trajectory has no positions (or places) or there are more than 2^27
/// pairs, and Error if a descriptor or a similarity is not finite, if the descriptors do not belong
/// to the trajectory, or if the task decides per query.
PairResult evaluate_pairs(const Task& task, const Trajectory& trajectory,
                          const Descriptors& descriptors, const PairOptions& options = {});

}  // namespace revisit
