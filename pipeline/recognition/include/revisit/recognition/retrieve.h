#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/recognition/matrix.h"
#include "revisit/recognition/similarity.h"

namespace revisit::pipeline {

/// Half-open range of positions in RetrievalTask::stored.
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

/// Which scans of a data set are stored and which are asked. Scans are rows of the data set.
struct RetrievalTask {
  std::string name;                // for messages: "paper-easy", "online", "ssc", ...
  std::vector<int64_t> stored;     // rows, ascending
  std::vector<TaskQuery> queries;  // by row; only scans with at least one candidate
};

/// How sure a retrieval is (paper, section III-D).
enum class Score {
  kMargin,  // s = 2 c1 - ck: high when the best is similar AND stands out from the k-th
  kBest,    // c1, the similarity of the best alone
};
/// "margin" or "cosine" (kBest, which is a cosine for most features); throws UsageError for
/// anything else.
Score parse_score(const std::string& text);
const char* name_of(Score score);

struct RetrieveOptions {
  int k = 4;  // how many stored scans are retrieved; with fewer stored, all of them
  Score score = Score::kMargin;
  std::function<void(int64_t done, int64_t total)> progress;  // in queries
  std::function<bool()> stop;                                 // true: throw Interrupted
  Similarity similarity;                                      // the feature's own; empty: cosine
  int threads = 1;  // for a similarity of the feature's own, and for PlaceIndex
};

/// What the map answers to one query.
struct Match {
  int64_t query = 0;           // row of the data set
  std::vector<int64_t> ranks;  // rows of the stored scans, best first; min(k, candidates) of them
  std::vector<double> similarities;  // of the same scans, not increasing; cosines by default
  double score = 0;
  int which_case = 1;  // the alignment case (1 or 2) of the query's descriptor that won
  /// Heading of the query less heading of the best, counter-clockwise [rad], where the descriptors
  /// tell it.
  std::optional<double> turn = {};
};

/// The k most similar stored scans of every query of `task`, by cosine or as `options` say.
///
/// `case1` [n][d] has one descriptor a scan of the data set, of any length: for cosines they are
/// normalised inside. A zero vector has cosine 0 with everything. With `case2` (same shape; the
/// scans described in alignment case 2) each query is asked in both cases and the higher score
/// wins, case 1 on a tie; stored scans always use case 1.
///
///   auto matches = retrieve(descriptors, task, {.k = 4});
///   auto both = retrieve(descriptors, task, {}, &descriptors_case2);
///
/// Equal similarities are ordered by row, lower first. The result does not depend on the number of
/// threads: the matrix product only selects, what is kept is computed again in double precision.
/// Memory beyond the inputs is bounded (about 130 MB), whatever n and d.
/// Throws UsageError for k or threads < 1, Error when shapes do not fit or a descriptor or a
/// similarity is not finite.
std::vector<Match> retrieve(const FloatMatrix& case1, const RetrievalTask& task,
                            const RetrieveOptions& options = {},
                            const FloatMatrix* case2 = nullptr);

}  // namespace revisit::pipeline
