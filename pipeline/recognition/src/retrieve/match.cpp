#include "revisit/recognition/match.h"

#include <algorithm>

#include "revisit/base/error.h"

namespace revisit::pipeline {

Score parse_score(const std::string& text) {
  if (text == "margin") return Score::kMargin;
  if (text == "similarity" || text == "cosine") return Score::kSimilarity;
  throw UsageError(str("score: expected margin or similarity, found '", text, "'"));
}

const char* name_of(Score score) {
  return score == Score::kMargin ? "margin" : "cosine";
}

double recall_of(std::span<const Match> exact, std::span<const Match> found) {
  if (exact.size() != found.size())
    throw UsageError(
        str("recall: expected answers to ", exact.size(), " queries, found ", found.size()));
  int64_t ranks = 0, both = 0;
  for (size_t q = 0; q < exact.size(); ++q)
    for (const int64_t place : exact[q].ranks) {
      ++ranks;
      both += std::ranges::count(found[q].ranks, place);
    }
  return ranks > 0 ? static_cast<double>(both) / static_cast<double>(ranks) : 1;
}

}  // namespace revisit::pipeline
