#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace revisit {

enum class Score {
  /// 2 c1 - ck: the best's similarity plus its margin to the k-th (paper, section III-D).
  kMargin,
  /// As kMargin with the k-th distinct place (Comparison::same_place), so that it does not depend
  /// on how densely places are stored.
  kDistinctMargin,
  kSimilarity,  // c1, the similarity of the best
  /// c1 plus the inlier ratio of a registered loop (LoopDetector); not computed by PlaceIndex.
  kVerified,
};
/// Parses "margin", "distinct-margin", "similarity" (in files: "cosine") or "verified"; throws
/// UsageError for anything else.
Score parse_score(const std::string& text);
/// Returns the name in files: "margin", "distinct-margin", "cosine" or "verified".
const char* name_of(Score score);

/// Indices count from 0: map entries for a PlaceIndex, rows of the data set for the evaluation.
struct Match {
  int64_t query = 0;
  /// Map entries, best first: min(k, candidates). For Score::kDistinctMargin, distinct places only;
  /// if fewer than k are distinct, the last entry examined is appended.
  std::vector<int64_t> ranks;
  std::vector<double> similarities;  // [ranks], non-increasing; cosines by default
  double score = 0;
  int which_case = 1;  // alignment case of the query's best descriptor: 1 or 2
  /// yaw(query) - yaw(best), counter-clockwise [rad], if the descriptors determine it.
  std::optional<double> relative_yaw = {};
};

}  // namespace revisit
