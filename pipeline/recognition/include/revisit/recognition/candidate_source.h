#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace revisit::pipeline {

/// Proposes places by their keys (Comparison::make_key) without looking at all of them, so that it
/// may miss some. What it proposes is compared exactly afterwards.
class CandidateSource {
 public:
  virtual ~CandidateSource() = default;
  /// It knows the places 0 to size() - 1.
  virtual int64_t size() const = 0;
  /// `key` is that of place size().
  virtual void add(std::span<const float> key) = 0;
  /// Puts up to `count` different places into `places`, in any order: those whose keys have the
  /// largest products with `key`, as far as it finds them. Called from several threads at once.
  virtual void find(std::span<const float> key, int64_t count,
                    std::vector<int64_t>& places) const = 0;
};

}  // namespace revisit::pipeline
