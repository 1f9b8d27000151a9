#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace revisit {

/// Map entries that a query may return, [begin, end). Entries in no range are excluded.
struct CandidateRange {
  int64_t begin = 0, end = 0;
  int64_t size() const { return end - begin; }
};

/// Proposes map entries. It may miss some; an exact comparison follows.
class CandidateSource {
 public:
  virtual ~CandidateSource() = default;
  /// Entries are 0 to size() - 1.
  virtual int64_t size() const = 0;
  virtual void add(std::span<const float> descriptor) = 0;
  /// Writes distinct entries to `places`, in any order: the `count` of `among` most similar to
  /// `query`, or fewer if it finds fewer. `among` is ascending, without empty ranges, within
  /// size(). Must be thread-safe. `threads` are used by this call and do not change the result.
  virtual void find(std::span<const float> query, std::span<const CandidateRange> among,
                    int64_t count, int threads, std::vector<int64_t>& places) const = 0;
};

}  // namespace revisit
