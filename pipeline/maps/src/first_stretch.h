#pragma once

#include <cstdint>
#include <iterator>
#include <optional>
#include <span>
#include <vector>

#include "revisit/recognition/feature.h"
#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// The first places of a map, from which its basis is learnt: from distinct ones, so that neither a
/// halt nor a dense drive makes the basis one of a few places. A place is distinct when it does not
/// look like the last distinct one (Comparison::same_place), by what was learnt from those before;
/// every place is where similarities do not tell. What is learnt depends on the order of the places
/// alone, not on how many come at once, so that all who read a map learn the same.
class FirstStretch {
 public:
  /// It ends with `distinct` distinct places, or with kMostWaiting times as many places: their
  /// features are all kept, as places between distinct ones are to be described with the basis,
  /// too.
  FirstStretch(const FeatureExtractor& extractor, int64_t distinct);

  void add(std::span<const float> feature);
  bool is_over() const { return over_; }
  const FloatMatrix& features() const { return features_; }

  /// Learnt from the distinct places: from all once it is over, else from the first 1, 2, 4, ... of
  /// them. Expects a place.
  const Basis& basis();
  /// So many places the basis was learnt from: another number, another basis.
  int64_t learnt_from() const { return learnt_from_; }

 private:
  static constexpr int64_t kMostWaiting = 5;
  bool is_distinct(std::span<const float> feature);

  const FeatureExtractor& extractor_;
  int64_t wanted_;
  FloatMatrix features_;           // of all places
  std::vector<int64_t> distinct_;  // rows of them
  bool over_ = false;
  std::optional<Basis> basis_;
  int64_t learnt_from_ = 0;
};

}  // namespace revisit::pipeline
