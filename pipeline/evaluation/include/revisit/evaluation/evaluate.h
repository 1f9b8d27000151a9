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

namespace revisit::pipeline {

struct EvaluationOptions {
  std::vector<std::string> protocols = {"online"};
  // These replace what the protocols say.
  std::optional<Distance> distance;
  std::optional<double> radius;        // [m]
  std::optional<double> false_beyond;  // [m]
  std::optional<Exclusion> exclusion;
  std::optional<QueryCase> query_case;
  std::optional<Score> score;  // absent: as the feature and the protocol have it

  int k = 4;                       // retrieved scans a query
  int resamples = 1000;            // of the bootstrap; 0: none
  std::optional<Exclusion> block;  // of the same: blocks_of()
  int threads = 1;                 // of retrieval and bootstrap; the figures do not depend on it
  DescribeOptions describe;
  ReductionOptions reduction;
  std::filesystem::path cache;    // folder of the features
  bool keep_descriptors = false;  // in the cache, too
};

/// Loops that are accepted from a score on that was not chosen on this drive.
struct AcceptedLoops {
  double threshold = 0;
  int64_t right = 0, neither = 0, wrong = 0;
  int64_t not_judged = 0;  // of queries that a list of pairs does not know
};

struct TaskResult {
  Task task;
  Score score = Score::kMargin;
  std::vector<Match> matches;     // as task.queries; none when pairs are decided
  std::vector<Verdict> verdicts;  // of the same
  std::vector<PrPoint> curve;
  PrSummary summary;
  std::optional<PrIntervals> intervals;     // absent: not asked for
  BlockCounts blocks;                       // that were resampled
  std::optional<ScoreHistogram> histogram;  // when pairs are decided
  std::string query_case;                   // none, case1, case2 or both
  std::string pca_fit;
  int64_t descriptor_dim = 0;          // after the reduction
  std::optional<AcceptedLoops> loops;  // of a causal evaluation with a threshold
  int64_t n_left_out = 0;  // scans that could not be described: neither stored nor asked

  bool on_pairs() const { return task.decision == Decision::kPair; }
  /// Of each query: its score reaches the threshold of the best F1. All false when there is none.
  std::vector<bool> accepted() const;
};

/// Judges the matches of a task that decides on queries: fills what follows them in `result`.
/// Throws Interrupted, and what judge() and blocks_of() do.
void measure(TaskResult& result, const Trajectory& trajectory, const EvaluationOptions& options,
             const std::function<bool()>& stop);

/// Where the time went. Of scans that an earlier run described, what it took then.
struct EvaluationTimes {
  DescribeTimes describe;
  std::vector<double> reduce, retrieve;  // [ms], all threads together, of each task
  std::vector<double> recognise;         // [ms], of each scan of a drive evaluated causally
};

struct EvaluationResult {
  std::vector<TaskResult> tasks;
  std::vector<AlignmentRecord> alignments;  // of each scan, as stored
  std::vector<int64_t> left_out;            // rows of the scans that could not be described
  EvaluationTimes times;
};

/// Throws what make_tasks() throws, and UsageError for a task twice or without known distances.
std::vector<Task> evaluation_tasks(const EvaluationOptions& options, const std::string& sequence,
                                   const Trajectory& trajectory);

/// Describes every scan, retrieves, and judges; what is in the cache is not computed again.
///
///   auto trajectory = make_trajectory(dataset);
///   Evaluation evaluation(dataset, extractor, trajectory,
///                         evaluation_tasks(options, dataset.sequence, trajectory), options);
///   evaluation.run().tasks.at(0).summary.average_precision;
class Evaluation {
 public:
  /// Refers to `dataset` (of camera_images() for a feature that sees images), `extractor` and
  /// `trajectory`. Throws UsageError for a query case that the alignment or a task does not have.
  Evaluation(const Dataset& dataset, const FeatureExtractor& extractor,
             const Trajectory& trajectory, std::vector<Task> tasks, EvaluationOptions options,
             Observer observer = {});
  Evaluation(const Evaluation&) = delete;
  Evaluation& operator=(const Evaluation&) = delete;

  /// Names what the figures depend on, but for the options.
  std::string key() const;
  /// Where the features are or will be, the stored scans' first; the second only when asked for.
  std::vector<std::filesystem::path> feature_files() const;
  /// Throws what describing and reducing throw; Interrupted keeps what was done in the cache.
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
  DatasetFeatures case1_;  // as stored: in case 1, or not aligned at all
  DatasetFeatures case2_;
  std::set<std::string> said_;
};

/// Heading of the query minus heading of its match, counter-clockwise [deg] in (-180, 180], by the
/// descriptors (Match::turn), else by the alignments of both clouds.
double relative_yaw_deg(const Match& match, const std::vector<AlignmentRecord>& alignments);

}  // namespace revisit::pipeline
