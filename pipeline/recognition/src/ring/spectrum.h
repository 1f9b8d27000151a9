#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "revisit/recognition/ring/model.h"

namespace revisit {

inline constexpr int kRingFrequencies = 17;

/// Position of one of the two rings in the feature of a scan.
struct RingPart {
  int sectors = 0, features = 0, weights = 1;
  int64_t first = 0, first_weight = 0;  // indices in a feature
  int64_t size() const { return int64_t{sectors} * features; }
  /// [sectors]
  const float* weights_of(const float* feature, int i) const {
    return feature + first_weight + static_cast<ptrdiff_t>(i % weights) * sectors;
  }
};
std::array<RingPart, 2> parts_of(const RingModel& model);

/// Fourier coefficients of a ring minus `mean` [features][sectors], times its weights w, so that an
/// unseen sector counts as the mean:
///   X_f = 1/sqrt(N) sum over k of w[k] (x[k] - mean[k]) exp(-2 pi i f k / N)  (METHODS, eq. 1),
/// [kRingFrequencies][features]. Frequencies beyond N/2 are aliases.
class Spectrum {
 public:
  explicit Spectrum(int sectors);
  Eigen::MatrixXcf of(const float* feature, const float* mean, const RingPart& part) const;
  /// Transforms a fully seen ring without a mean.
  Eigen::MatrixXcf of(const std::vector<float>& ring, int features) const;

 private:
  Eigen::MatrixXcf of(const Eigen::MatrixXf& ring) const;  // [sectors][features]

  Eigen::MatrixXcf waves_;  // [kRingFrequencies][sectors]
};

/// Projection of a ring's Fourier coefficients: [frequency], [kept][features].
using RingProjection = std::vector<Eigen::MatrixXcf>;

/// Computes the most discriminative directions (METHODS, eq. 4) for `dim` real dimensions of a
/// descriptor: one per direction at frequency 0, two at others. With pairs of scans they solve
/// B_f v = l (T_f + M_f M_f^H + eps tr(.)/d 1) v with V^H (.) V = 1; each is weighted by sqrt(l),
/// largest l first. Without pairs: (.)^-0.3 instead, largest variance first.
RingProjection project_rings(const RingStatistics& ring, double regularization, int dim);

double trace(const std::vector<Eigen::MatrixXcd>& matrices);

}  // namespace revisit
