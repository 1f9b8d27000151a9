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

/// Proposes places by less than their whole descriptors, so that it may miss some. What it proposes
/// is compared exactly afterwards.
class CandidateSource {
 public:
  virtual ~CandidateSource() = default;
  /// It knows the places 0 to size() - 1.
  virtual int64_t size() const = 0;
  /// `descriptor` is that of place size().
  virtual void add(std::span<const float> descriptor) = 0;
  /// Puts different places into `places`, in any order: as far as it finds them the `count` of
  /// `among` (ascending, none empty, within size()) most similar to `query`. What is not in `among`
  /// does not count. Called from several threads at once; `threads` are for this call, and the
  /// result is the same for any number.
  virtual void find(std::span<const float> query, std::span<const CandidateRange> among,
                    int64_t count, int threads, std::vector<int64_t>& places) const = 0;
};

}  // namespace revisit::pipeline
