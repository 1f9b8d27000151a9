#include "ring/spectrum.h"

#include <cmath>
#include <numbers>

namespace revisit {

std::array<RingPlace, 2> rings_of(const RingModel& model) {
  const RingStatistics &columns = model.columns, &polar = model.polar;
  const int64_t weights = columns.size() + polar.size();
  return {RingPlace{columns.sectors, columns.numbers, columns.weights, 0, weights},
          RingPlace{polar.sectors, polar.numbers, polar.weights, columns.size(),
                    weights + columns.weights_size()}};
}

Spectrum::Spectrum(int sectors) : waves_(kRingFrequencies, sectors) {
  for (int f = 0; f < kRingFrequencies; ++f)
    for (int k = 0; k < sectors; ++k) {
      const double angle = -2 * std::numbers::pi * (f * k % sectors) / sectors;
      waves_(f, k) = std::complex<float>(std::polar(1 / std::sqrt(double(sectors)), angle));
    }
}

Eigen::MatrixXcf Spectrum::of(const float* feature, const float* mean,
                              const RingPlace& place) const {
  Eigen::MatrixXf centered(place.sectors, place.numbers);
  const float* x = feature + place.first;
  for (int i = 0; i < place.numbers; ++i) {
    const float* const weights = place.weights_of(feature, i);
    for (int k = 0; k < place.sectors; ++k) centered(k, i) = weights[k] * (*x++ - *mean++);
  }
  return of(centered);
}

Eigen::MatrixXcf Spectrum::of(const std::vector<float>& ring, int numbers) const {
  return of(Eigen::Map<const Eigen::MatrixXf>(ring.data(), waves_.cols(), numbers));
}

Eigen::MatrixXcf Spectrum::of(const Eigen::MatrixXf& ring) const {
  Eigen::MatrixXcf spectrum(waves_.rows(), ring.cols());
  spectrum.real() = waves_.real() * ring;
  spectrum.imag() = waves_.imag() * ring;
  return spectrum;
}

}  // namespace revisit
