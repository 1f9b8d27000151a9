#include "revisit/recognition/match.h"

#include "revisit/base/error.h"

namespace revisit {

Score parse_score(const std::string& text) {
  if (text == "margin") return Score::kMargin;
  if (text == "distinct-margin") return Score::kDistinctMargin;
  if (text == "similarity" || text == "cosine") return Score::kSimilarity;
  if (text == "verified") return Score::kVerified;
  throw UsageError(
      str("score: expected margin, distinct-margin or similarity, found '", text, "'"));
}

const char* name_of(Score score) {
  switch (score) {
    case Score::kMargin:
      return "margin";
    case Score::kDistinctMargin:
      return "distinct-margin";
    case Score::kVerified:
      return "verified";
    case Score::kSimilarity:
      break;
  }
  return "cosine";
}

}  // namespace revisit
