#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "revisit/datasets/perturbation.h"
#include "revisit/evaluation/descriptors.h"
#include "revisit/evaluation/precision_recall.h"
#include "revisit/evaluation/protocols.h"

namespace revisit {

/// Settings of an Evaluation. The optional ones replace those of the protocols.
struct EvaluationOptions {
  std::vector<std::string> protocols = {"online"};  ///< names for make_tasks()
  std::optional<Distance> distance;                 ///< of MatchRule
  std::optional<double> radius;                     ///< [m]
  std::optional<double> negative_radius;            ///< [m]
  std::optional<Exclusion> exclusion;               ///< temporal neighbors
  std::optional<QueryCase> query_case;              ///< alignment of the queries
  std::optional<Score> score;  ///< absent: default of the feature and the protocol

  int k = 4;                       ///< retrieved scans per query
  int resamples = 1000;            ///< 0: no intervals
  std::optional<Exclusion> block;  ///< bootstrap blocks: blocks_of()
  int threads = 1;                 ///< for retrieval and bootstrap; does not affect the metrics
  DescribeOptions describe;        ///< scans to features
  ReductionOptions reduction;      ///< features to descriptors
  std::filesystem::path cache;     ///< folder of the features
  bool keep_descriptors = false;   ///< in the cache
};

/// Histogram of scores: bin i is [low + i width, low + (i + 1) width).
struct ScoreHistogram {
  static constexpr int kBins = 60;  ///< number of bins
  double low = 0, width = 0;        ///< lower edge of bin 0, and width of a bin
  std::array<int64_t, kBins> of_correct{}, of_incorrect{};  ///< counts by label
};

/// Loops accepted with a threshold that was not chosen on this drive.
struct AcceptedLoops {
  double threshold = 0;                             ///< minimum score
  int64_t correct = 0, ignored = 0, incorrect = 0;  ///< accepted, by label
  int64_t unlabeled = 0;                            ///< not in the list of pairs
};

/// Of queries that are perturbed scans. A neighbor is a correct match other than the original.
struct PerturbedFigures {
  Perturbation perturbation;  ///< of the queries
  int64_t self = 0;           ///< queries that retrieve their original
  int64_t neighbor = 0;       ///< of the positives: queries that retrieve a neighbor
  /// Similarity of the best neighbor / of the best scan of another place; NaN without neighbors.
  double ratio_median = 0, ratio_min = 0;
  int64_t skipped = 0;  ///< match nothing, with similarity 0
};

/// Result of one task.
struct TaskResult {
  Task task;                     ///< its scans and rule
  Score score = Score::kMargin;  ///< kind of the scores
  /// In the order of task.queries; empty if the decision is per pair, and for perturbed queries
  std::vector<Match> matches;
  std::vector<MatchLabel> labels;               ///< of `matches`
  std::vector<PrPoint> curve;                   ///< highest threshold first
  PrSummary summary;                            ///< metrics of the curve
  std::optional<PrIntervals> intervals;         ///< absent without resamples
  int64_t n_blocks = 0, n_positive_blocks = 0;  ///< count_blocks()
  std::optional<ScoreHistogram> histogram;      ///< if the decision is per pair
  std::string query_case;                       ///< none, case1, case2 or both
  std::string pca_fit;                          ///< Descriptors::pca_fit
  int64_t descriptor_dim = 0;                   ///< dimensions of a descriptor
  std::optional<AcceptedLoops> loops;           ///< in driving order, with a threshold
  std::optional<PerturbedFigures> perturbed;    ///< of evaluate_perturbed()
  int64_t n_skipped = 0;                        ///< neither stored nor queried

  /// Per query: score >= threshold of the maximum F1. All false without a threshold.
  std::vector<bool> accepted() const;
};

/// Evaluates a task that accepts pairs of a query and a candidate by a similarity threshold. A pair
/// nearer than the rule's radius is correct if it is outside the task's exclusion, else ignored.
/// `negatives_per_positive` incorrect pairs are drawn at random with a fixed seed. Similarities are
/// compared as floats: 82 MB for all pairs of 4541 scans. Candidates that compact codes exclude
/// have similarity -1. Only the descriptors of alignment case 1 are compared. Fills summary,
/// intervals and blocks (resampled over queries, each with all of its pairs; not for 0 resamples),
/// histogram, and the curve (like precision_recall(), thinned to about 1000 points).
///
/// Throws UsageError if the trajectory has no positions (or places) or there are more than 2^27
/// pairs, and Error if a descriptor or a similarity is not finite, if the descriptors do not belong
/// to the trajectory, or if the task decides per query.
TaskResult evaluate_pairs(const Task& task, const Trajectory& trajectory,
                          const Descriptors& descriptors,
                          const BootstrapOptions& options = {.resamples = 0});

/// Evaluates the matches of a task that decides per query and fills the members of `result` that
/// depend on them. Throws Interrupted, and what label_matches() and blocks_of() throw.
void measure(TaskResult& result, const Trajectory& trajectory, const EvaluationOptions& options,
             const std::function<bool()>& stop);

/// Result of all tasks of a data set.
struct EvaluationResult {
  std::vector<TaskResult> tasks;            ///< in the given order
  std::vector<AlignmentRecord> alignments;  ///< per scan, as stored
  std::vector<int64_t> skipped;             ///< rows
  /// Durations. For scans described by an earlier run they are those of that run.
  DescribeTimes describe_times;
  std::vector<double> reduce_ms, retrieve_ms;  ///< per task, summed over threads
  std::vector<double> recognize_ms;            ///< per scan, in driving order
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
  const Descriptors& descriptors_of(const Task& task, DatasetFeatures* case2);
  TaskResult evaluate(const Task& task, const Descriptors& descriptors, EvaluationResult& whole);
  QueryCase query_case_of(const Task& task) const;
  void note_once(const std::string& text);

  const Trajectory& trajectory_;
  std::vector<Task> tasks_;
  EvaluationOptions options_;
  Observer observer_;
  DatasetFeatures case1_;  ///< as stored: case 1, or not aligned
  DatasetFeatures case2_;
  std::optional<Descriptors> descriptors_;  ///< of the last task
  std::vector<int64_t> stored_;             ///< by that task
  std::set<std::string> said_;
};

/// Queries of evaluate_perturbed().
struct PerturbedQueries {
  std::vector<Perturbation> perturbations = standard_perturbations();  ///< a task each
  uint32_t seed = 0;                                                   ///< of the perturbations
  int64_t n = 0;                     ///< perturbed scans, evenly spaced in the drive; 0: all
  std::vector<Dataset> distractors;  ///< other places by the same sensor
};

/// Perturbs scans of a drive and uses each as a query against the unperturbed drive and the
/// distractors: a task per perturbation. Candidates are all scans beyond `options.exclusion`, which
/// is none by default and always excludes the original; with Trajectory::listed only earlier scans.
/// The score is MapOptions::score. Features are cached, so that an interrupted call
/// can be resumed. Ignores protocols, k, resamples and score of `options`.
///
/// Throws UsageError for a drive without poses (for Distance::kPlace: place names), a feature of
/// camera images or invalid options; Interrupted; and what describing and reducing throw.
EvaluationResult evaluate_perturbed(const Dataset& drive, const Trajectory& trajectory,
                                    const FeatureExtractor& extractor,
                                    const PerturbedQueries& perturbed,
                                    const EvaluationOptions& options,
                                    const Observer& observer = {});

/// yaw(query) - yaw(match), CCW [deg] in (-180, 180], from the descriptors (Match::relative_yaw),
/// else from the alignments of both clouds.
double relative_yaw_deg(const Match& match, const std::vector<AlignmentRecord>& alignments);

}  // namespace revisit
