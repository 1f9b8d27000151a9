#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "revisit/recognition/ring/descriptor.h"
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

/// Projection of a ring's Fourier coefficients: [frequency], [kept][features].
using RingProjection = std::vector<Eigen::MatrixXcf>;

/// Computes the most discriminative directions for `numbers` real dimensions of a descriptor: one
/// per direction at frequency 0, two at others. T_f is the total covariance plus, for f > 0, the
/// mean's M_f M_f^H. With pairs: B_f v = l (T_f + eps tr(T_f)/d 1) v, V^H T V = 1, weighted by
/// sqrt(l), largest l first. Without pairs: T_f^-0.3, largest variance first.
RingProjection project_rings(const RingStatistics& ring, double regularization, int numbers);

double trace(const std::vector<Eigen::MatrixXcd>& spreads);

}  // namespace revisit
