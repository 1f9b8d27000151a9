#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "revisit/recognition/candidate_source.h"

namespace revisit {

inline constexpr int64_t kEntriesPerBlock = 1024;

inline int64_t places_of(std::span<const CandidateRange> ranges) {
  int64_t sum = 0;
  for (const CandidateRange& range : ranges) sum += range.size();
  return sum;
}

/// Calls `run(place, n)` for entries [from, to), counted over `ranges`. The n <= most entries of a
/// run are consecutive in one block.
template <class Run>
void for_each_run(std::span<const CandidateRange> ranges, int64_t from, int64_t to, int64_t most,
                  const Run& run) {
  int64_t before = 0;
  for (const CandidateRange& range : ranges) {
    const int64_t last = std::min(range.end, range.begin + to - before);
    for (int64_t place = range.begin + std::max<int64_t>(0, from - before); place < last;) {
      const int64_t n = std::min({last - place, kEntriesPerBlock - place % kEntriesPerBlock, most});
      run(place, n);
      place += n;
    }
    before += range.size();
  }
}

}  // namespace revisit
