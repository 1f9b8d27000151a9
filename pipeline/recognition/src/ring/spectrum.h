#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// Frequencies 0 to 16 are looked at.
inline constexpr int kRingFrequencies = 17;

/// Where a ring stands among the floats of a feature.
struct RingPlace {
  int sectors = 0, numbers = 0;
  int64_t first = 0;  // float
};
std::array<RingPlace, 2> rings_of(const RingModel& model);

/// Fourier coefficients of a ring `[numbers][sectors]` less `mean`:
///   X_f = 1/sqrt(N) sum over k of x[k] exp(-2 pi i f k / N),
/// a row a frequency: [kRingFrequencies][numbers]. Frequencies beyond N/2 are those of a ring that
/// is sampled too coarsely.
class Spectrum {
 public:
  explicit Spectrum(int sectors);
  Eigen::MatrixXcf of(const float* ring, const float* mean, int numbers) const;

 private:
  Eigen::MatrixXcf waves_;  // [kRingFrequencies][sectors]
};

}  // namespace revisit::pipeline
