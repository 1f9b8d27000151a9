#include "revisit/recognition/ring/descriptor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "revisit/base/error.h"
#include "ring/codes.h"
#include "ring/correlation.h"
#include "ring/describer.h"

namespace revisit {
namespace {

/// Consecutive scans are above it; 85 pairs of different, similar real places have 0.24 to 0.54.
constexpr double kSamePlace = 0.65;

/// Sum over f of Re(g[f] exp(i f angle)).
struct Correlation {
  std::vector<std::complex<double>> g;

  Correlation(std::span<const float> a, std::span<const float> b, const RingLayout& layout) {
    size_t first = 0;
    for (size_t f = 0; f < layout.size(); ++f) {
      const auto count = static_cast<size_t>(layout[f]);
      const auto at = [&](std::span<const float> x, size_t i) {
        return std::complex<double>(x[first + i], f > 0 ? x[first + count + i] : 0);
      };
      std::complex<double> sum = 0;
      for (size_t i = 0; i < count; ++i) sum += at(a, i) * std::conj(at(b, i));
      g.push_back(sum);
      first += f > 0 ? 2 * count : count;
    }
  }
  /// Returns the n-th derivative.
  double at(double angle, int n = 0) const {
    double sum = 0;
    for (size_t f = 0; f < g.size(); ++f) {
      const auto frequency = static_cast<double>(f);
      sum += (g[f] * std::pow(std::complex<double>(0, frequency), n) *
              std::polar(1.0, frequency * angle))
                 .real();
    }
    return sum;
  }
};

}  // namespace

int64_t dim_of(const RingLayout& layout) {
  int64_t sum = 0;
  for (size_t f = 0; f < layout.size(); ++f) sum += (f == 0 ? 1 : 2) * int64_t{layout[f]};
  return sum;
}

RingMatch match_rings(std::span<const float> a, std::span<const float> b,
                      const RingLayout& layout) {
  const Correlation correlation(a, b, layout);
  constexpr double kStep = 2 * std::numbers::pi / kRingYaws;
  double best = 0, value = correlation.at(0);
  for (int s = 1; s < kRingYaws; ++s)
    if (const double other = correlation.at(s * kStep); other > value) {
      best = s * kStep;
      value = other;
    }
  // Newton's method.
  for (int i = 0; i < 5; ++i) {
    const double slope = correlation.at(best, 1), curvature = correlation.at(best, 2);
    if (!(curvature < 0)) break;
    best -= std::clamp(slope / curvature, -kStep, kStep);
  }
  // METHODS, eq. 7: sector k + s of a is sector k of b if yaw(b) - yaw(a) = -s, because azimuth
  // decreases with the sector.
  return {std::clamp(correlation.at(best), -1.0, 1.0), -std::remainder(best, 2 * std::numbers::pi)};
}

Comparison ring_comparison(const RingLayout& layout, int64_t candidates) {
  if (layout.size() > kRingFrequencies)
    throw UsageError("ring layout: expected at most ", kRingFrequencies, " frequencies, found ",
                     layout.size());
  RingLayout whole = layout;
  whole.resize(kRingFrequencies);
  Comparison rings;
  rings.similarity = [whole](std::span<const float> query,
                             std::span<const std::span<const float>> places,
                             std::span<double> similarities) {
    thread_local std::vector<const float*> rows;  // a query allocates nothing
    rows.clear();
    for (const std::span<const float> place : places) rows.push_back(place.data());
    max_correlations(query.data(), rows, whole, similarities);
  };
  rings.same_place = kSamePlace;
  rings.relative_yaw = [layout](std::span<const float> a, std::span<const float> b) {
    return match_rings(a, b, layout).relative_yaw;
  };
  rings.make_codes = [layout] { return std::make_unique<RingCodes>(layout); };
  rings.candidates = candidates;
  return rings;
}

void check_options(const RingOptions& options) {
  if (options.dim < 2 || options.dim > 1 << 16)
    throw UsageError("ring dimensions: expected 2 to 65536, found ", options.dim);
  if (!(options.regularization > 0) || !std::isfinite(options.regularization))
    throw UsageError("ring regularization: expected a value above 0, found ",
                     options.regularization);
  if (options.candidates < 0)
    throw UsageError("candidates: expected at least 0, found ", options.candidates);
  if (!(options.blend >= 0 && options.blend <= 1))
    throw UsageError("ring blend: expected 0 to 1, found ", options.blend);
}

RingDescriber::RingDescriber(const RingModel& model, const RingOptions& options)
    : means_{model.cnn.mean, model.polar.mean},
      shares_{model.cnn_weight, 1 - model.cnn_weight},
      parts_(parts_of(model)),
      spectra_{Spectrum(model.cnn.sectors), Spectrum(model.polar.sectors)} {
  check_options(options);
  for (size_t part = 0; part < 2; ++part)
    projections_[part] =
        project_rings(part == 0 ? model.cnn : model.polar, options.regularization, options.dim / 2);
  for (size_t f = 0; f < kRingFrequencies; ++f)
    layout_.push_back(static_cast<int>(projections_[0][f].rows() + projections_[1][f].rows()));
}

void RingDescriber::describe(std::span<const float> rings, std::span<float> descriptor) const {
  const float twice = std::numbers::sqrt2_v<float>;
  std::array<std::vector<Eigen::VectorXcf>, 2> z;  // [frequency] [kept]
  for (size_t part = 0; part < 2; ++part) {
    const RingPart& ring = parts_[part];
    const Eigen::MatrixXcf x = spectra_[part].of(rings.data(), means_[part].data(), ring);
    double square = 0;
    for (Eigen::Index f = 0; f < x.rows(); ++f) {
      Eigen::VectorXcf& of_frequency =
          z[part].emplace_back(projections_[part][static_cast<size_t>(f)] * x.row(f).transpose());
      // Frequencies above 0 also represent their negative counterparts.
      if (f == 0)
        of_frequency.imag().setZero();
      else
        of_frequency *= twice;
      square += static_cast<double>(of_frequency.squaredNorm());
    }
    const auto scale = square > 0 ? static_cast<float>(std::sqrt(shares_[part] / square)) : 0.0F;
    for (Eigen::VectorXcf& of_frequency : z[part]) of_frequency *= scale;
  }
  float* to = descriptor.data();
  for (size_t f = 0; f < layout_.size(); ++f) {
    for (const auto& part : z)
      for (const std::complex<float> value : part[f]) *to++ = value.real();
    if (f == 0) continue;
    for (const auto& part : z)
      for (const std::complex<float> value : part[f]) *to++ = value.imag();
  }
}

Projection ring_projection(const RingModel& model, const RingOptions& options) {
  const auto describer = std::make_shared<const RingDescriber>(model, options);
  Projection projection;
  projection.dim = dim_of(describer->layout());
  projection.describe = [describer](std::span<const float> rings, std::span<float> descriptor) {
    describer->describe(rings, descriptor);
  };
  projection.comparison = ring_comparison(describer->layout(), options.candidates);
  projection.content = ring_model_content(model);
  return projection;
}

}  // namespace revisit
