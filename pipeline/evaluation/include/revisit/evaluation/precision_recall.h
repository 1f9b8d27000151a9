#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "revisit/evaluation/protocols.h"
#include "revisit/recognition/match.h"

namespace revisit {

/// Score and ground truth of a query's best match.
struct MatchLabel {
  double score = 0;       ///< as thresholds are compared with
  bool correct = false;   ///< the best match is correct
  bool positive = false;  ///< at least one candidate of the query is a correct match
  bool ignored = false;   ///< the best match is neither correct nor incorrect (MatchRule)
};

/// Labels `matches`, which must correspond to `task.queries`. Throws UsageError if the trajectory
/// has no positions (or places), and Error if the matches do not belong to the task.
std::vector<MatchLabel> label_matches(const std::vector<Match>& matches, const Task& task,
                                      const Trajectory& trajectory, const MatchRule& rule);

/// Counts if every query with score >= threshold is accepted:
///   tp  accepted, and the match is correct
///   fp  accepted, and the match is neither correct nor ignored
///   fn  has a correct match among its candidates, but is no tp. By default: rejected, or
///       accepted with an incorrect match. The latter is an fp as well, so that tp + fn = positives
///       at every threshold. A query whose match is ignored is never an fn. With
///       `rejected_only`: rejected
///   tn  rejected, and has no correct match
struct PrPoint {
  double threshold = 0;                    ///< minimum score for acceptance
  int64_t tp = 0, fp = 0, fn = 0, tn = 0;  ///< numbers of queries, see above
  double precision = 0;  ///< tp / (tp + fp); NaN if all accepted matches are ignored
  double recall = 0;     ///< tp / (tp + fn), 0 for tp = 0; NaN without positives
  double f1 = 0;         ///< 2 tp / (2 tp + fp + fn), 0 for tp = 0; NaN without positives
};

/// One point per distinct score, highest first. Throws Error for NaN or contradictory labels.
std::vector<PrPoint> precision_recall(const std::vector<MatchLabel>& labels,
                                      bool rejected_only = false);

/// Value of a metric that does not exist: NaN.
inline constexpr double kNotComputed = std::numeric_limits<double>::quiet_NaN();

/// NaN: not computed, because there are no positives.
struct PrSummary {
  int64_t n_queries = 0;                     ///< with at least one decision
  int64_t n_positives = 0;                   ///< with at least one correct match
  int64_t n_pairs = 0, n_correct_pairs = 0;  ///< if the decision is per pair; else 0
  double f1_max = kNotComputed;              ///< over the points of the curve
  double f1_max_threshold = kNotComputed;    ///< highest threshold that reaches f1_max
  /// Sum over the points of (R_i - R_{i-1}) P_i, no interpolation.
  double average_precision = kNotComputed;
  /// Positives whose best match is correct / positives; NaN for pairs.
  double recall_at_1 = kNotComputed;
  double max_recall_at_precision_1 = kNotComputed;  ///< 0 if the highest score is already incorrect
  /// (P_R0 + R_P100) / 2: precision at the highest threshold and maximum recall at 100 % precision
  /// (Ferrarini, Waheed, Waheed, Ehsan, Milford, McDonald-Maier, RA-L 2020).
  double extended_precision = kNotComputed;
};
/// Metrics of precision_recall().
PrSummary summarize(const std::vector<MatchLabel>& labels, bool rejected_only = false);

/// Percentile block bootstrap (Carlstein 1986; Künsch 1989): each resample draws as many blocks of
/// consecutive queries as there are, with replacement. Queries of a block show the same street:
/// resampling single queries (Efron 1979) would make the intervals too narrow.
struct BootstrapOptions {
  std::vector<int64_t> blocks;                                ///< per query: id of its block
  int resamples = 1000;                                       ///< 0: no intervals
  double confidence = 0.95;                                   ///< of the intervals, 0 to 1
  uint64_t seed = 1;                                          ///< of the draws
  int threads = 1;                                            ///< does not affect the result
  std::function<void(int64_t done, int64_t total)> progress;  ///< of evaluate_pairs(), in queries
  std::function<bool()> stop;                                 ///< true: throw Interrupted
};

/// Number of blocks, and of those with a positive query, which decide the width of intervals.
std::pair<int64_t, int64_t> count_blocks(const BootstrapOptions& options,
                                         const std::function<bool(size_t query)>& is_positive);

/// Default length of a block: 100 m driven, beyond which errors are almost uncorrelated. Without
/// poses 50 frames, as in the default Exclusion: about 50 m of KITTI, 100 m of keyframes 2 m apart.
inline constexpr Exclusion kBlockOfPath{Exclusion::Kind::kMeters, 100};
inline constexpr Exclusion kBlockOfFrames{Exclusion::Kind::kFrames, 50};  ///< without poses

/// Block of each query of the task. Absent length: the default; Exclusion::Kind::kNone: each query
/// is a block. With named places each place is a block. Throws UsageError if `length` is 0 or needs
/// times or poses that are missing.
std::vector<int64_t> blocks_of(const Task& task, const Trajectory& trajectory,
                               const std::optional<Exclusion>& length = {});

/// Lower and upper bounds; NaN: not computed.
struct PrIntervals {
  std::array<double, 2> f1_max, average_precision, recall_at_1, max_recall_at_precision_1,
      extended_precision;  ///< bounds of the metric of PrSummary with this name
};

/// Resamples without a positive are skipped. With a single block nothing is computed. The intervals
/// do not cover the variation between drives, which is larger.
/// Throws UsageError for less than 1 resample or thread, a confidence outside (0, 1), and unless
/// `blocks` has one id per query.
PrIntervals bootstrap(const std::vector<MatchLabel>& labels, bool rejected_only = false,
                      const BootstrapOptions& options = {});

}  // namespace revisit
