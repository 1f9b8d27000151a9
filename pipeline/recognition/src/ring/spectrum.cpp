#include "ring/spectrum.h"

#include <cmath>
#include <numbers>

namespace revisit::pipeline {

std::array<RingPlace, 2> rings_of(const RingModel& model) {
  return {RingPlace{model.columns.sectors, model.columns.numbers, 0},
          RingPlace{model.polar.sectors, model.polar.numbers, model.columns.size()}};
}

Spectrum::Spectrum(int sectors) : waves_(kRingFrequencies, sectors) {
  for (int f = 0; f < kRingFrequencies; ++f)
    for (int k = 0; k < sectors; ++k) {
      const double angle = -2 * std::numbers::pi * (f * k % sectors) / sectors;
      waves_(f, k) = std::complex<float>(std::polar(1 / std::sqrt(double(sectors)), angle));
    }
}

Eigen::MatrixXcf Spectrum::of(const float* ring, const float* mean, int numbers) const {
  using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Eigen::Map<const RowMajor> x(ring, numbers, waves_.cols()), m(mean, numbers, waves_.cols());
  const Eigen::MatrixXf centred = (x - m).transpose();  // [sectors][numbers]
  Eigen::MatrixXcf spectrum(waves_.rows(), numbers);
  spectrum.real() = waves_.real() * centred;
  spectrum.imag() = waves_.imag() * centred;
  return spectrum;
}

}  // namespace revisit::pipeline
