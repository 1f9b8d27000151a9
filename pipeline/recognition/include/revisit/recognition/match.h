#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// Confidence score of a match.
enum class Score {
  /// s = 2 c1 - ck: high if the best is similar and has a margin to the k-th (paper, section
  /// III-D).
  kMargin,
  /// As kMargin, with the k-th of distinct places (Comparison::same_place): neighbors and other
  /// passes of the best are skipped. It does not depend on how densely places are stored.
  kDistinctMargin,
  kSimilarity,  // c1, the similarity of the best
  /// For a registered loop: c1 plus the inlier ratio (LoopDetector). PlaceIndex does not compute
  /// it.
  kVerified,
};
/// Parses "margin", "distinct-margin", "similarity" (in files: "cosine") or "verified"; throws
/// UsageError for anything else.
Score parse_score(const std::string& text);
/// Returns the name in files: "margin", "distinct-margin", "cosine" or "verified".
const char* name_of(Score score);

/// Result of one query. Indices count from 0: queries and map entries for a PlaceIndex, rows of the
/// data set for a task of the evaluation.
struct Match {
  int64_t query = 0;
  /// Map entries, best first: min(k, candidates). For Score::kDistinctMargin, distinct places only;
  /// if fewer than k are distinct, the last entry examined is appended.
  std::vector<int64_t> ranks;
  std::vector<double> similarities;  // of `ranks`, non-increasing; cosines by default
  double score = 0;
  int which_case = 1;  // alignment case (1 or 2) of the query's best descriptor
  /// yaw(query) - yaw(best), counter-clockwise [rad], if the descriptors determine it.
  std::optional<double> relative_yaw = {};
};

}  // namespace revisit::pipeline
