#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// How sure a match is.
enum class Score {
  /// s = 2 c1 - ck: high when the best is similar AND stands out from the k-th (paper, section
  /// III-D).
  kMargin,
  /// The same with the k-th of distinct places (Comparison::same_place), so that neighbours and
  /// other passes of the best are not what it has to stand out from: it does not depend on how
  /// densely places are stored.
  kDistinctMargin,
  kSimilarity,  // c1, the similarity of the best alone
  /// Of a loop that was registered: c1 plus the inlier ratio (LoopDetector). No index has it.
  kVerified,
};
/// "margin", "distinct-margin", "similarity", which files call "cosine", or "verified"; throws
/// UsageError for anything else.
Score parse_score(const std::string& text);
/// "margin", "distinct-margin", "cosine" or "verified", as in files.
const char* name_of(Score score);

/// The answer to one query. Of a PlaceIndex, queries and places are counted from 0; of a task of
/// the evaluation, both are rows of the data set.
struct Match {
  int64_t query = 0;
  /// Places, best first; min(k, candidates) of them. Of Score::kDistinctMargin the distinct ones;
  /// with fewer than k of these the last place looked at stands behind them.
  std::vector<int64_t> ranks;
  std::vector<double> similarities;  // of the same places, not increasing; cosines by default
  double score = 0;
  int which_case = 1;  // the alignment case (1 or 2) of the query's descriptor that won
  /// Heading of the query less heading of the best, counter-clockwise [rad], where the descriptors
  /// tell it.
  std::optional<double> turn = {};
};

}  // namespace revisit::pipeline
