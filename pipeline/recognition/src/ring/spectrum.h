#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "revisit/recognition/ring/model.h"

namespace revisit {

inline constexpr int kRingFrequencies = 17;

struct RingPlace {
  int sectors = 0, numbers = 0, weights = 1;
  int64_t first = 0, first_weight = 0;  // indices in a feature
  int64_t size() const { return int64_t{sectors} * numbers; }
  /// [sectors]
  const float* weights_of(const float* feature, int i) const {
    return feature + first_weight + static_cast<ptrdiff_t>(i % weights) * sectors;
  }
};
std::array<RingPlace, 2> rings_of(const RingModel& model);

/// Fourier coefficients of a ring minus `mean` [features][sectors], times its weights w, so that an
/// unseen sector counts as the mean:
///   X_f = 1/sqrt(N) sum over k of w[k] (x[k] - mean[k]) exp(-2 pi i f k / N),
/// [kRingFrequencies][features]. Frequencies beyond N/2 are aliases.
class Spectrum {
 public:
  explicit Spectrum(int sectors);
  Eigen::MatrixXcf of(const float* feature, const float* mean, const RingPlace& place) const;
  /// Transforms a fully seen ring without a mean.
  Eigen::MatrixXcf of(const std::vector<float>& ring, int numbers) const;

 private:
  Eigen::MatrixXcf of(const Eigen::MatrixXf& ring) const;  // [sectors][numbers]

  Eigen::MatrixXcf waves_;  // [kRingFrequencies][sectors]
};

}  // namespace revisit
