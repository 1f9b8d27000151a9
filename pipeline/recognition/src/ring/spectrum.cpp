#include "ring/spectrum.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "revisit/recognition/matrix.h"

namespace revisit {

std::array<RingPart, 2> parts_of(const RingModel& model) {
  const RingStatistics &cnn = model.cnn, &polar = model.polar;
  const int64_t weights = cnn.size() + polar.size();
  return {RingPart{cnn.sectors, cnn.features, cnn.weights, 0, weights},
          RingPart{polar.sectors, polar.features, polar.weights, cnn.size(),
                   weights + cnn.weights_size()}};
}

Spectrum::Spectrum(int sectors) : waves_(kRingFrequencies, sectors) {
  for (int f = 0; f < kRingFrequencies; ++f)
    for (int k = 0; k < sectors; ++k) {
      const double angle = -2 * std::numbers::pi * (f * k % sectors) / sectors;
      waves_(f, k) = std::complex<float>(std::polar(1 / std::sqrt(double(sectors)), angle));
    }
}

Eigen::MatrixXcf Spectrum::of(const float* feature, const float* mean, const RingPart& part) const {
  Eigen::MatrixXf centered(part.sectors, part.features);
  const float* x = feature + part.first;
  for (int i = 0; i < part.features; ++i) {
    const float* const weights = part.weights_of(feature, i);
    for (int k = 0; k < part.sectors; ++k) centered(k, i) = weights[k] * (*x++ - *mean++);
  }
  return of(centered);
}

Eigen::MatrixXcf Spectrum::of(const std::vector<float>& ring, int features) const {
  return of(Eigen::Map<const Eigen::MatrixXf>(ring.data(), waves_.cols(), features));
}

Eigen::MatrixXcf Spectrum::of(const Eigen::MatrixXf& ring) const {
  Eigen::MatrixXcf spectrum(waves_.rows(), ring.cols());
  spectrum.real() = waves_.real() * ring;
  spectrum.imag() = waves_.imag() * ring;
  return spectrum;
}

namespace {

using Eigen::MatrixXcd;

struct Direction {
  int frequency = 0;
  double eigenvalue = 0;
  Eigen::VectorXcd v;  // scaled by its weight
};

/// Clamps eigenvalues, because complete agreement by chance must not count more.
void add_discriminants(int f, MatrixXcd shared, MatrixXcd total,
                       std::vector<Direction>& directions) {
  constexpr double kMost = 0.98;
  const std::vector<double> values =
      hermitian_eigenpairs(shared.data(), total.data(), total.rows());
  for (Eigen::Index i = 0; i < total.rows(); ++i) {
    const double l = std::clamp(values[static_cast<size_t>(i)], 0.0, kMost);
    directions.push_back({f, l, std::sqrt(l) * shared.col(i)});
  }
}

/// Adds partially whitened directions; full whitening would amplify noise.
void add_whitening(int f, MatrixXcd total, std::vector<Direction>& directions) {
  constexpr double kPower = -0.3;
  MatrixXcd one = MatrixXcd::Identity(total.rows(), total.rows());
  const std::vector<double> values = hermitian_eigenpairs(total.data(), one.data(), total.rows());
  for (Eigen::Index i = 0; i < total.rows(); ++i) {
    const double t = values[static_cast<size_t>(i)];
    directions.push_back({f, t, std::pow(t, kPower) * total.col(i)});
  }
}

}  // namespace

double trace(const std::vector<MatrixXcd>& matrices) {
  double sum = 0;
  for (const MatrixXcd& matrix : matrices) sum += matrix.trace().real();
  return sum;
}

RingProjection project_rings(const RingStatistics& ring, double regularization, int dim) {
  const auto d = static_cast<Eigen::Index>(ring.features);
  const double sum = trace(ring.total), unit = sum > 0 ? sum : 1;
  const Eigen::MatrixXcd mean =
      Spectrum(ring.sectors).of(ring.mean, ring.features).cast<std::complex<double>>();
  std::vector<Direction> directions;
  for (size_t f = 0; f < ring.total.size(); ++f) {
    MatrixXcd total = ring.total[f];
    // Eq. 4: at another yaw the mean is subtracted at the wrong angle, which carries no place
    // information. Frequency 0 does not depend on yaw.
    if (f > 0) {
      const Eigen::VectorXcd m = mean.row(static_cast<Eigen::Index>(f)).transpose();
      total += m * m.adjoint();
    }
    total /= unit;
    // Lower bound of the diagonal makes the covariance of a ring that never changes invertible.
    const double least = regularization * total.trace().real() / static_cast<double>(d);
    total.diagonal().array() += std::max(least, 1e-12);
    if (ring.shared.empty())
      add_whitening(static_cast<int>(f), total, directions);
    else
      add_discriminants(static_cast<int>(f), ring.shared[f] / unit, total, directions);
  }
  std::ranges::stable_sort(directions, std::greater(), &Direction::eigenvalue);
  std::vector<std::vector<const Direction*>> kept(ring.total.size());
  int used = 0;
  for (const Direction& direction : directions) {
    used += direction.frequency == 0 ? 1 : 2;
    if (used > dim || direction.eigenvalue <= 0) break;
    kept[static_cast<size_t>(direction.frequency)].push_back(&direction);
  }
  RingProjection projection;
  for (const auto& of_frequency : kept) {
    Eigen::MatrixXcf& rows =
        projection.emplace_back(static_cast<Eigen::Index>(of_frequency.size()), d);
    for (size_t i = 0; i < of_frequency.size(); ++i)
      rows.row(static_cast<Eigen::Index>(i)) =
          of_frequency[i]->v.adjoint().cast<std::complex<float>>();
  }
  return projection;
}

}  // namespace revisit
