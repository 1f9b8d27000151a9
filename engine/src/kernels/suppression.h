#pragma once

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

struct Candidate {
  float score;
  int32_t box;
};

/// Orders best first. Never equal, so std::sort is deterministic without a stable sort's memory.
inline bool is_better(const Candidate& a, const Candidate& b) {
  return a.score != b.score ? a.score > b.score : a.box < b.box;
}

/// Greedy non-maximum suppression of sorted candidates: one is kept unless a kept one
/// `suppresses(kept, candidate)`. Calls `after_each()` after each kept one. Moves the kept ones to
/// the front, in order; returns their number.
template <typename Suppresses, typename AfterEach>
int64_t keep_unsuppressed(Candidate* candidates, int64_t n, const Suppresses& suppresses,
                          const AfterEach& after_each) {
  int64_t kept = 0;
  for (int64_t i = 0; i < n; ++i) {
    const Candidate candidate = candidates[i];
    if (std::any_of(candidates, candidates + kept,
                    [&](const Candidate& other) { return suppresses(other, candidate); }))
      continue;
    candidates[kept++] = candidate;
    after_each();
  }
  return kept;
}

template <typename Suppresses>
int64_t keep_unsuppressed(Candidate* candidates, int64_t n, const Suppresses& suppresses) {
  return keep_unsuppressed(candidates, n, suppresses, [] {});
}

}  // namespace revisit::engine
