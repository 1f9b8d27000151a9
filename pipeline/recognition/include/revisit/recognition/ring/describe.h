#pragma once

#include <memory>
#include <span>
#include <vector>

#include "revisit/recognition/ring/match.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

struct RingOptions {
  int numbers = 1024;  // of a descriptor: half of them of each ring
  /// Share of the model's total spread that the map's own takes the place of (learn_rings() on the
  /// map's scans gives it); 0: the model's alone. A map of n scans has n / (n + 128) of it, as few
  /// scans do not know their spread.
  double adapt = 0;
  /// Added to the total spread, in units of its mean eigenvalue: how much small variances count.
  double regularisation = 1e-2;
  /// Compared are so many candidates, those with the most similar keys (ring_key()); 0: all.
  int64_t key_candidates = 0;
};

/// Turns rings into descriptors: less the ring mean, along frequencies, onto the directions in
/// which scans of one place agree and scans of different places differ (linear discriminant
/// analysis of each frequency, docs/RINGS.md), to unit length. Copies share what was computed.
class RingDescriber {
 public:
  /// `mean` [model.dim()]: the ring mean of the map's scans; that of another sensor or of simulated
  /// scans hides what real places share. With `spread` (of the map, by learn_rings()) and
  /// options.adapt the model's total spread is adapted. Throws UsageError for options that are
  /// none.
  RingDescriber(const RingModel& model, std::vector<float> mean, const RingOptions& options = {},
                const RingModel* spread = nullptr);

  const RingLayout& layout() const;
  /// `rings` [model.dim()] -> `descriptor` [layout().numbers()], of length 1; all zero for rings
  /// that are the mean.
  void describe(std::span<const float> rings, std::span<float> descriptor) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace revisit::pipeline
