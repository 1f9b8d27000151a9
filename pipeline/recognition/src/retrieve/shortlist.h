#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "revisit/recognition/match.h"

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

/// `rows` is [products.size()][key.size()].
void products_of_rows(std::span<const float> key, const float* rows, std::span<float> products);

/// Error bound of a float cosine of `d` dimensions: four times sqrt(d) roundings.
inline float rounding_of_cosines(int64_t d) {
  return 1e-6F + 4 * 6e-8F * std::sqrt(static_cast<float>(d));
}

/// Keeps the `count` best of approximate scores that arrive in any order; ties go to the lower
/// positions. With a `slack`, everything within it of the last one is kept, too, so that rounding
/// loses nothing. The result does not depend on the order or on how Shortlists were merged.
class Shortlist {
 public:
  struct Entry {
    float rough;
    int64_t position;
  };

  Shortlist() = default;
  Shortlist(int64_t count, float slack) { begin(count, slack); }

  void begin(int64_t count, float slack) {
    count_ = static_cast<size_t>(count);
    slack_ = slack;
    floor_ = -std::numeric_limits<float>::infinity();
    entries_.clear();
    plan_next_prune();
  }
  void offer(float rough, int64_t position) {
    if (rough < floor_) return;
    entries_.push_back({rough, position});
    if (entries_.size() >= next_prune_) prune();
  }
  void offer(const Shortlist& other) {
    for (const Entry& entry : other.entries_) offer(entry.rough, entry.position);
  }
  /// Ascending by position.
  std::span<const Entry> finish() {
    prune();
    std::ranges::sort(entries_, {}, &Entry::position);
    return entries_;
  }

 private:
  void prune() {
    if (entries_.size() > count_) {
      const auto last = entries_.begin() + static_cast<int64_t>(count_) - 1;
      std::nth_element(entries_.begin(), last, entries_.end(), [](const Entry& a, const Entry& b) {
        return a.rough != b.rough ? a.rough > b.rough : a.position < b.position;
      });
      floor_ = last->rough - slack_;
      if (slack_ > 0)
        std::erase_if(entries_, [this](const Entry& e) { return e.rough < floor_; });
      else
        entries_.resize(count_);
    }
    plan_next_prune();
  }
  void plan_next_prune() {
    next_prune_ = std::max<size_t>(64, 2 * std::max(entries_.size(), count_));
    entries_.reserve(next_prune_);
  }

  size_t count_ = 0;
  float slack_ = 0, floor_ = 0;
  size_t next_prune_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace revisit
