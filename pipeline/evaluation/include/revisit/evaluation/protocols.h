#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "revisit/evaluation/ground_truth.h"
#include "revisit/recognition/place_index.h"

namespace revisit {

/// A query and the stored scans it is compared with, as indices into Task::stored.
struct TaskQuery {
  int64_t scan = 0;  ///< row of the data set
  /// Ranges before and after the excluded one; the second may be empty.
  std::array<CandidateRange, 2> candidates{};
  /// Stored scans that may be matched.
  int64_t n_candidates() const { return candidates[0].size() + candidates[1].size(); }
};

/// Stored scans, queries and ground truth rule. Scans are rows, because frames may have gaps.
struct Task {
  std::string name;                ///< for messages: "paper-easy", "online", "ssc", ...
  std::vector<int64_t> stored;     ///< rows, ascending
  std::vector<TaskQuery> queries;  ///< by row; only scans with at least one candidate
  std::string definition;          ///< for display and result files
  std::string population;          ///< stored scans and queries, for display
  bool both_cases = false;         ///< queries are described in both alignment cases
  MatchRule rule;                  ///< default of the protocol; the caller may replace it
  Exclusion exclusion{Exclusion::Kind::kNone, 0};  ///< temporal neighbors
  /// Unit of precision and recall. True: each pair of a query and a candidate (evaluate_pairs());
  /// false: the best match of each query (precision_recall()).
  bool decides_on_pairs = false;
  /// Positives that count as false negatives. False: all but the true positives, so recall is over
  /// all positives. True: only rejected ones; one accepted with an incorrect match is a false
  /// positive only.
  bool rejected_only = false;
  /// True: the score is s = 2 c1 - ck; false: c1, the best similarity
  bool margin_score = true;
  int negatives_per_positive = 0;  ///< random incorrect pairs per correct one; 0: all
};

/// A published or common way to evaluate.
struct Protocol {
  std::string name;        ///< for make_tasks()
  std::string definition;  ///< scans and rule, for display
  std::string source;      ///< publication
};

/// docs/reference/EVALUATION.md has the formulas.
const std::vector<Protocol>& protocols();
std::vector<std::string> protocol_names();  ///< of protocols()

/// `paper` returns all of the paper's tasks for the sequence: easy and median for 00, 05, 06; easy,
/// median and difficult for 08; easy alone for others. Every other protocol has one task. Median,
/// difficult and bevplace store fixed frames of KITTI's sequences: the trajectory must have as many
/// poses (Trajectory::n_poses) as the official one.
///
///   for (const Task& task : make_tasks("paper", "00", trajectory)) {
///     auto matches = retrieve(descriptors, task);
///     auto labels = label_matches(matches, task, trajectory, task.rule);
///     auto curve = precision_recall(labels, task.rejected_only);
///   }
///
/// Tasks that decide on pairs need evaluate_pairs() instead. `exclusion` replaces the protocol's
/// own; protocols with fixed stored scans (the paper's, bevplace) have none and ignore it. With
/// Trajectory::listed, the list is the ground truth, and unlisted queries are not queried.
///
/// Throws UsageError for an unknown name, a task that the sequence does not have, another drive
/// with the name of a KITTI sequence, and if no scan of the data set is stored or can be queried.
/// With a list it also throws UsageError if no query has a place to be found, or if the protocol
/// excludes no temporal neighbors (unless `exclusion` is none).
std::vector<Task> make_tasks(const std::string& protocol, const std::string& sequence,
                             const Trajectory& trajectory,
                             const std::optional<Exclusion>& exclusion = {});

/// Removes scans from the stored ones and the queries. Throws UsageError if none of either remains.
void remove_scans(Task& task, const std::vector<int64_t>& rows);

}  // namespace revisit
