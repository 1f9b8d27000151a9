#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace revisit::pipeline {

/// Places that may be found, [begin, end): what is in no range is left out.
struct CandidateRange {
  int64_t begin = 0, end = 0;
  int64_t size() const { return end - begin; }
};

/// Proposes places by a part of their descriptors, may miss some; an exact comparison follows.
class CandidateSource {
 public:
  virtual ~CandidateSource() = default;
  /// It knows the places 0 to size() - 1.
  virtual int64_t size() const = 0;
  /// `descriptor` is that of place size().
  virtual void add(std::span<const float> descriptor) = 0;
  /// Puts different places, in any order, into `places`: the `count` of `among` (ascending, none
  /// empty, within size()) most similar to `query`, as far as it finds them. Called from several
  /// threads at once; `threads` are for this call, and do not change the result.
  virtual void find(std::span<const float> query, std::span<const CandidateRange> among,
                    int64_t count, int threads, std::vector<int64_t>& places) const = 0;
};

}  // namespace revisit::pipeline
