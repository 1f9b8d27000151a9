#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "revisit/evaluation/bootstrap.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/similarity.h"

namespace revisit::pipeline {

/// How alike a scan is to others: larger is more alike, `similarities[i]` belongs to
/// `candidates[i]`. Rows of the data set. Called from several threads at once.
using PairSimilarity = std::function<void(int64_t query, std::span<const int64_t> candidates,
                                          std::span<double> similarities)>;

/// How alike the scans of descriptors [n][d] are, which must outlive the result: by the feature's
/// `own` similarity, or by cosine when that is empty (a zero vector has cosine 0 with everything).
/// Throws Error when a descriptor is not finite.
PairSimilarity pair_similarity(const FloatMatrix& descriptors, const Similarity& own = {});

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
  std::optional<PrIntervals> intervals;  // over the queries, each with all of its pairs
  std::vector<PrPoint> curve;            // as precision_recall(), thinned to about 1000 points
  ScoreHistogram histogram;
};

/// Evaluates a task that decides on pairs: a pair of a query and one of its candidates is accepted
/// when its similarity is at least the threshold.
///
/// A pair nearer than the rule's radius is true when it is beyond the task's exclusion, and not
/// counted otherwise; a pair that the rule calls false is false. With `negatives_per_positive` so
/// many false ones are drawn at random, the same in every run. Similarities are compared as
/// floats, so that a pair takes 8 bytes: 82 MB for all pairs of 4541 scans.
///
///   auto task = make_tasks("ssc", "00", trajectory).at(0);
///   auto result = evaluate_pairs(task, trajectory, pair_similarity(descriptors));
///   result.summary.f1_max;
///
/// Throws UsageError when the trajectory has no positions (or places) or there are more than 2^27
/// pairs to compare, Error when a similarity is not finite or the task decides on queries.
PairResult evaluate_pairs(const Task& task, const Trajectory& trajectory,
                          const PairSimilarity& similarity, const PairOptions& options = {});

}  // namespace revisit::pipeline
