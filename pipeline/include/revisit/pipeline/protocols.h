#pragma once

#include <array>
#include <string>
#include <vector>

#include "revisit/pipeline/ground_truth.h"

namespace revisit::pipeline {

/// Half-open range of positions in Task::stored.
struct CandidateRange {
  int64_t begin = 0, end = 0;
  int64_t size() const { return end - begin; }
};

/// One scan to recognise and the stored scans it is compared with.
struct TaskQuery {
  int64_t scan = 0;                            // row of the data set
  std::array<CandidateRange, 2> candidates{};  // before and after a hole; the second may be empty
  int64_t n_candidates() const { return candidates[0].size() + candidates[1].size(); }
};

/// A place-recognition task: which scans of a data set are stored, which are asked.
/// Scans are rows of the data set, so a subsampled drive (gaps in the frame numbers) works alike.
struct Task {
  std::string name;                // "paper-easy", "paper-median", "paper-difficult", "online", ...
  std::string population;          // for people: what is stored and what is asked
  std::vector<int64_t> stored;     // rows, ascending
  std::vector<TaskQuery> queries;  // by row; only scans with at least one candidate
  bool both_cases = false;         // describe the queries in both alignment cases
  TrueMatchRule rule;              // the protocol's own; the command line may replace it
  Exclusion exclusion{Exclusion::Kind::kNone, 0};
};

/// What `--protocol` takes: "paper", "paper-easy", "paper-median", "paper-difficult", "online",
/// "leave-one-out".
std::vector<std::string> protocol_names();

/// The tasks of a protocol on one sequence.
///
/// - `paper`: all of the paper's tasks that exist for the sequence: easy and median for 00, 05, 06;
///   easy, median and difficult for 08; easy alone for any other. True match: box, 3 m.
///   - `paper-easy`: every 3rd scan stored (frame % 3 == 0), the rest are queries.
///   - `paper-median`: the stored scans of Table 1 (1-based and inclusive there; frame = index -
///   1),
///     all others are queries, in alignment case 1 only.
///   - `paper-difficult`: the same for 08 with the queries in both cases.
/// - `online`: every scan is a query against the earlier scans beyond the exclusion. xz, 5 m.
/// - `leave-one-out`: every scan against all scans, before and after it, beyond the exclusion. xz,
/// 5 m.
///
///   for (const Task& task : make_tasks("paper", "00", trajectory, exclusion)) {
///     auto matches = retrieve(descriptors, task);
///     auto verdicts = judge(matches, task, trajectory, task.rule);
///     auto curve = precision_recall(verdicts);
///   }
///
/// The exclusion is not used by the paper's tasks (their stored and query scans are disjoint).
/// Throws UsageError for an unknown name, a task the sequence does not have, and when no scan of
/// the data set is stored or none can be asked.
std::vector<Task> make_tasks(const std::string& protocol, const std::string& sequence,
                             const Trajectory& trajectory, const Exclusion& exclusion = {});

}  // namespace revisit::pipeline
