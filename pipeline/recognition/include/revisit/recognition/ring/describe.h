#pragma once

#include <memory>
#include <span>

#include "revisit/recognition/ring/match.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

struct RingOptions {
  int dim = 1024;  // dimensions of a descriptor, half of them for each ring
  /// Added to the total covariance, in units of its mean eigenvalue. A larger value gives
  /// directions of small variance less weight.
  double regularization = 1e-2;
  double blend = 0.3;  // see fit_to_map()
  /// Number of candidates compared exactly, preselected by compact codes (match.h); 0: all.
  int64_t code_candidates = 0;
};

/// Throws UsageError for invalid options.
void check_options(const RingOptions& options);

/// Projects the ring descriptors of a scan to the vector that is stored and compared. Where
/// something was seen, the map mean is subtracted. Each frequency is projected onto directions that
/// agree only between scans of one place (LDA, docs/METHODS.md). RingModel::cnn_weight weights the
/// two rings. Copies share the projection.
class RingDescriber {
 public:
  /// `model` must be fitted to the map by fit_to_map(). Throws UsageError for invalid options.
  explicit RingDescriber(const RingModel& model, const RingOptions& options = {});

  const RingLayout& layout() const;
  /// Computes `descriptor` [layout().numbers()] from `rings` [model.dim()], a feature of
  /// ring_features(). The length is 1; parts that were not seen contribute 0.
  void describe(std::span<const float> rings, std::span<float> descriptor) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace revisit
