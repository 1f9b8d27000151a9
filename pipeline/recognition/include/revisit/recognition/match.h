#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// How sure a match is (paper, section III-D).
enum class Score {
  kMargin,      // s = 2 c1 - ck: high when the best is similar AND stands out from the k-th
  kSimilarity,  // c1, the similarity of the best alone
};
/// "margin" or "similarity", which files call "cosine"; throws UsageError for anything else.
Score parse_score(const std::string& text);
/// "margin" or "cosine", as in files.
const char* name_of(Score score);

/// The answer to one query. Of a PlaceIndex, queries and places are counted from 0; of a task of
/// the evaluation, both are rows of the data set.
struct Match {
  int64_t query = 0;
  std::vector<int64_t> ranks;        // places, best first; min(k, candidates) of them
  std::vector<double> similarities;  // of the same places, not increasing; cosines by default
  double score = 0;
  int which_case = 1;  // the alignment case (1 or 2) of the query's descriptor that won
  /// Heading of the query less heading of the best, counter-clockwise [rad], where the descriptors
  /// tell it.
  std::optional<double> turn = {};
};

}  // namespace revisit::pipeline
