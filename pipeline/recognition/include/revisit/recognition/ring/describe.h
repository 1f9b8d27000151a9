#pragma once

#include <memory>
#include <span>

#include "revisit/recognition/ring/match.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

struct RingOptions {
  int numbers = 1024;  // of a descriptor: half of them of each ring
  /// Added to the total spread, in units of its mean eigenvalue: how much small variances count.
  double regularisation = 1e-2;
  double adapt = 0.3;  // see fit_to_map()
  /// This many candidates are compared, those with the most similar keys (match.h); 0: all.
  int64_t key_candidates = 0;
};

/// Throws UsageError for invalid options.
void check_options(const RingOptions& options);

/// Turns rings into descriptors. The ring mean is subtracted where something was seen. Each
/// frequency is projected onto directions in which only scans of one place agree (LDA,
/// docs/METHODS.md). RingModel::columns_share scales the rings. Copies share what was computed.
class RingDescriber {
 public:
  /// `model`: of the map, by fit_to_map(). Throws UsageError for invalid options.
  explicit RingDescriber(const RingModel& model, const RingOptions& options = {});

  const RingLayout& layout() const;
  /// `rings` [model.dim()] -> `descriptor` [layout().numbers()], of length 1; unseen rings add 0.
  void describe(std::span<const float> rings, std::span<float> descriptor) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace revisit::pipeline
