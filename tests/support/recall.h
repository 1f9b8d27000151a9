#pragma once

#include <algorithm>
#include <span>

#include "revisit/recognition/match.h"

namespace revisit {

/// Fraction of the ranks of `exact` that `found` contains. Both answer the same queries.
inline double recall_of(std::span<const Match> exact, std::span<const Match> found) {
  int64_t ranks = 0, both = 0;
  for (size_t q = 0; q < exact.size(); ++q)
    for (const int64_t place : exact[q].ranks) {
      ++ranks;
      both += std::ranges::count(found[q].ranks, place);
    }
  return static_cast<double>(both) / static_cast<double>(ranks);
}

}  // namespace revisit
