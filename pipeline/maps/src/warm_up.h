#pragma once

#include <cstdint>
#include <iterator>
#include <optional>
#include <span>
#include <vector>

#include "revisit/recognition/feature.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

/// Collects the first entries of a map, from which its descriptor projection is estimated. Only
/// distinct entries count, so that a halt or dense sampling does not bias the projection. An entry
/// is distinct if it does not look like the last distinct one (Comparison::same_place) under the
/// projection of the preceding ones; without a same_place every entry is. The result depends only
/// on the order of the entries, so that all readers of a map obtain the same projection.
class WarmUp {
 public:
  /// Ends after `distinct` distinct entries, or after kMaxEntriesPerDistinct times as many entries.
  /// All features are kept, because entries between distinct ones are described again, too.
  WarmUp(const FeatureExtractor& extractor, int64_t distinct);

  void add(std::span<const float> feature);
  bool is_over() const { return over_; }
  const FloatMatrix& features() const { return features_; }

  /// Projection estimated from all distinct entries once the warm-up is over, before from the first
  /// 1, 2, 4, ... of them. Requires at least one entry.
  const Projection& projection();
  /// Changes if and only if the projection changes.
  int64_t estimated_from() const { return fitted_to_; }

 private:
  static constexpr int64_t kMaxEntriesPerDistinct = 5;
  bool is_distinct(std::span<const float> feature);

  const FeatureExtractor& extractor_;
  int64_t wanted_;
  FloatMatrix features_;
  std::vector<int64_t> distinct_;
  bool over_ = false;
  std::optional<Projection> projection_;
  int64_t fitted_to_ = 0;
};

}  // namespace revisit
