#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "revisit/evaluation/ground_truth.h"
#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

/// What is accepted or rejected, and so what precision and recall count.
enum class Decision {
  kQuery,  // the best match of each query (precision_recall.h)
  kPair,   // each pair of a query and a candidate (pairs.h)
};

/// Which positives are false negatives.
enum class Missed {
  kNotFound,  // all but the true positives: recall is over all positives
  kRejected,  // the rejected ones: a positive accepted with a wrong match is a false positive only
};

/// One scan to recognise and the stored scans it is compared with: positions in Task::stored.
struct TaskQuery {
  int64_t scan = 0;                            // row of the data set
  std::array<CandidateRange, 2> candidates{};  // before and after a hole; the second may be empty
  int64_t n_candidates() const { return candidates[0].size() + candidates[1].size(); }
};

/// Which scans are stored, which are asked, what is true. Scans are rows: frames may have gaps.
struct Task {
  std::string name;                // for messages: "paper-easy", "online", "ssc", ...
  std::vector<int64_t> stored;     // rows, ascending
  std::vector<TaskQuery> queries;  // by row; only scans with at least one candidate
  std::string definition;          // of the protocol, for people and for the results
  std::string population;          // for people: what is stored and what is asked
  bool both_cases = false;         // describe the queries in both alignment cases
  TrueMatchRule rule;              // the protocol's own; the command line may replace it
  Exclusion exclusion{Exclusion::Kind::kNone, 0};
  Decision decision = Decision::kQuery;
  Missed missed = Missed::kNotFound;
  bool margin_score = true;        // s = 2 c1 - ck says how sure; false: c1, the best alone
  int negatives_per_positive = 0;  // pairs: so many random negatives a positive; 0: all of them
};

struct Protocol {
  std::string name;
  std::string definition;  // one line
  std::string source;      // where it was published
};

/// What `--protocol` takes, with definitions; docs/EVALUATION.md has the formulas.
const std::vector<Protocol>& protocols();
std::vector<std::string> protocol_names();

/// The tasks of a protocol on one sequence.
///
/// `paper` gives all of the paper's tasks that exist for the sequence: easy and median for 00, 05,
/// 06; easy, median and difficult for 08; easy alone for any other. Every other name gives one.
/// Median, difficult and bevplace store frames that are listed for KITTI's drives: the trajectory
/// must be of a drive with as many poses (Trajectory::n_poses) as the official one.
///
///   for (const Task& task : make_tasks("paper", "00", trajectory)) {
///     auto matches = retrieve(descriptors, task);
///     auto verdicts = judge(matches, task, trajectory, task.rule);
///     auto curve = precision_recall(verdicts, task.missed);
///   }
///
/// Tasks with Decision::kPair go to evaluate_pairs() instead. `exclusion` replaces the protocol's
/// own; those that store fixed scans (the paper's, bevplace) have none and do not use it.
/// With Trajectory::listed the list is the truth, and queries that it does not know are not asked.
/// Throws UsageError for an unknown name, a task the sequence does not have, another drive under
/// the name of one of KITTI's, when no scan of the data set is stored or none can be asked, and
/// with a list when no query has a place to be found, or the protocol excludes no neighbours of
/// queries (unless `exclusion` is none).
std::vector<Task> make_tasks(const std::string& protocol, const std::string& sequence,
                             const Trajectory& trajectory,
                             const std::optional<Exclusion>& exclusion = {});

/// Removes scans (rows) from a task. Throws UsageError when nothing is stored or asked any more.
void leave_out(Task& task, const std::vector<int64_t>& rows);

}  // namespace revisit::pipeline
