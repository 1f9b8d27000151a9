#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "revisit/evaluation/bootstrap.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/pairs.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/evaluation/protocols.h"
#include "revisit/evaluation/retrieve.h"

namespace revisit {

struct EvaluationOptions {
  std::vector<std::string> protocols = {"online"};
  // Overrides of the protocols.
  std::optional<Distance> distance;
  std::optional<double> radius;        // [m]
  std::optional<double> false_beyond;  // [m]
  std::optional<Exclusion> exclusion;
  std::optional<QueryCase> query_case;
  std::optional<Score> score;  // absent: default of the feature and the protocol

  int k = 4;                       // retrieved scans per query
  int resamples = 1000;            // 0: no intervals
  std::optional<Exclusion> block;  // bootstrap blocks: blocks_of()
  int threads = 1;                 // for retrieval and bootstrap; does not affect the metrics
  DescribeOptions describe;
  ReductionOptions reduction;
  std::filesystem::path cache;
  bool keep_descriptors = false;  // in the cache
};

/// Loops accepted with a threshold that was not chosen on this drive.
struct AcceptedLoops {
  double threshold = 0;
  int64_t correct = 0, ignored = 0, incorrect = 0;
  int64_t unlabeled = 0;  // not in the list of pairs
};

struct TaskResult {
  Task task;
  Score score = Score::kMargin;
  std::vector<Match> matches;  // in the order of task.queries; empty if the decision is per pair
  std::vector<MatchLabel> labels;
  std::vector<PrPoint> curve;
  PrSummary summary;
  std::optional<PrIntervals> intervals;
  BlockCounts blocks;
  std::optional<ScoreHistogram> histogram;  // if the decision is per pair
  std::string query_case;                   // none, case1, case2 or both
  std::string pca_fit;
  int64_t descriptor_dim = 0;
  std::optional<AcceptedLoops> loops;  // for a causal evaluation with a threshold
  int64_t n_skipped = 0;               // neither stored nor queried

  bool on_pairs() const { return task.decision == Decision::kPair; }
  /// Per query: score >= threshold of the maximum F1. All false without a threshold.
  std::vector<bool> accepted() const;
};

/// Evaluates the matches of a task with Decision::kQuery and fills the members of `result` that
/// depend on them. Throws Interrupted, and what label_matches() and blocks_of() throw.
void measure(TaskResult& result, const Trajectory& trajectory, const EvaluationOptions& options,
             const std::function<bool()>& stop);

/// Durations for scans described by an earlier run are those of that run.
struct EvaluationTimes {
  DescribeTimes describe;
  std::vector<double> reduce, retrieve;  // [ms] per task, summed over threads
  std::vector<double> recognize;         // [ms] per scan of a drive evaluated causally
};

struct EvaluationResult {
  std::vector<TaskResult> tasks;
  std::vector<AlignmentRecord> alignments;  // per scan, as stored
  std::vector<int64_t> skipped;             // rows
  EvaluationTimes times;
};

/// Throws what make_tasks() throws, and UsageError for a duplicate task or without distances.
std::vector<Task> evaluation_tasks(const EvaluationOptions& options, const std::string& sequence,
                                   const Trajectory& trajectory);

/// Describes all scans, retrieves and evaluates; cached results are not computed again.
///
///   auto trajectory = make_trajectory(dataset);
///   Evaluation evaluation(dataset, extractor, trajectory,
///                         evaluation_tasks(options, dataset.sequence, trajectory), options);
///   evaluation.run().tasks.at(0).summary.average_precision;
class Evaluation {
 public:
  /// Keeps references to `dataset` (of camera_images() for a feature of images), `extractor` and
  /// `trajectory`. Throws UsageError for a query case that the alignment or a task does not
  /// support.
  Evaluation(const Dataset& dataset, const FeatureExtractor& extractor,
             const Trajectory& trajectory, std::vector<Task> tasks, EvaluationOptions options,
             Observer observer = {});
  Evaluation(const Evaluation&) = delete;
  Evaluation& operator=(const Evaluation&) = delete;

  /// Key of everything that affects the metrics, without the options.
  std::string key() const;
  /// Paths of the features, existing or not: stored scans first, case 2 only if it is needed.
  std::vector<std::filesystem::path> feature_files() const;
  /// Throws what describing and reducing throw. Interrupted leaves finished work in the cache.
  EvaluationResult run();

 private:
  bool needs_case2() const;
  TaskResult evaluate(const Task& task, TaskDescriptors& all, EvaluationTimes& times);
  QueryCase query_case_of(const Task& task) const;
  void note_once(const std::string& text);

  const Trajectory& trajectory_;
  std::vector<Task> tasks_;
  EvaluationOptions options_;
  Observer observer_;
  DatasetFeatures case1_;  // as stored: case 1, or not aligned
  DatasetFeatures case2_;
  std::set<std::string> said_;
};

/// yaw(query) - yaw(match), CCW [deg] in (-180, 180], from the descriptors (Match::relative_yaw),
/// else from the alignments of both clouds.
double relative_yaw_deg(const Match& match, const std::vector<AlignmentRecord>& alignments);

}  // namespace revisit
