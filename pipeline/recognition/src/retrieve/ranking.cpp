#include "retrieve/ranking.h"

#include <algorithm>

namespace revisit::pipeline {

Match best_match(int64_t query, std::vector<RankedScan>& candidates, int which_case,
                 const RetrieveOptions& options) {
  const auto kept = std::min<size_t>(static_cast<size_t>(options.k), candidates.size());
  std::partial_sort(candidates.begin(), candidates.begin() + static_cast<int64_t>(kept),
                    candidates.end());
  Match match;
  match.query = query;
  match.which_case = which_case;
  match.ranks.reserve(kept);
  match.similarities.reserve(kept);
  for (size_t i = 0; i < kept; ++i) {
    match.ranks.push_back(candidates[i].second);
    match.similarities.push_back(-candidates[i].first);
  }
  const double best = match.similarities.front(), kth = match.similarities.back();
  match.score = options.score == Score::kBest ? best : 2 * best - kth;
  return match;
}

}  // namespace revisit::pipeline
