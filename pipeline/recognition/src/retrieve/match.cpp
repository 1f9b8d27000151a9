#include "revisit/recognition/match.h"

#include "revisit/base/error.h"

namespace revisit::pipeline {

Score parse_score(const std::string& text) {
  if (text == "margin") return Score::kMargin;
  if (text == "similarity" || text == "cosine") return Score::kSimilarity;
  throw UsageError("score: expected margin or similarity, found '", text, "'");
}

const char* name_of(Score score) {
  return score == Score::kMargin ? "margin" : "cosine";
}

}  // namespace revisit::pipeline
