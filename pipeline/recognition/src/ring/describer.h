#pragma once

#include <array>
#include <span>
#include <vector>

#include "revisit/recognition/ring/descriptor.h"
#include "ring/spectrum.h"

namespace revisit {

/// Throws UsageError for invalid options.
void check_options(const RingOptions& options);

/// What ring_projection() does.
class RingDescriber {
 public:
  explicit RingDescriber(const RingModel& model, const RingOptions& options = {});
  const RingLayout& layout() const { return layout_; }
  /// Computes `descriptor` [dim_of(layout())] from `rings` [model.dim()].
  void describe(std::span<const float> rings, std::span<float> descriptor) const;

 private:
  std::array<std::vector<float>, 2> means_;
  std::array<double, 2> shares_;  // weights of the rings in a descriptor's squared length
  std::array<RingPart, 2> parts_;
  std::array<Spectrum, 2> spectra_;
  std::array<RingProjection, 2> projections_;
  RingLayout layout_;
};

}  // namespace revisit
