#include "revisit/recognition/ring/match.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "revisit/base/error.h"
#include "ring/correlation.h"
#include "ring/keys.h"
#include "ring/spectrum.h"

namespace revisit {
namespace {

/// Consecutive scans are above it; 85 pairs of different, similar real places have 0.24 to 0.54.
constexpr double kSamePlace = 0.65;

/// Sum over f of Re(g[f] exp(i f angle)).
struct Correlation {
  std::vector<std::complex<double>> g;

  Correlation(std::span<const float> a, std::span<const float> b, const RingLayout& layout) {
    size_t first = 0;
    for (size_t f = 0; f < layout.counts.size(); ++f) {
      const auto count = static_cast<size_t>(layout.counts[f]);
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

int64_t RingLayout::numbers() const {
  int64_t sum = 0;
  for (size_t f = 0; f < counts.size(); ++f) sum += (f == 0 ? 1 : 2) * int64_t{counts[f]};
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
  // Sector k + s of a is sector k of b if yaw(b) - yaw(a) = -s, because azimuth decreases with the
  // sector.
  return {std::clamp(correlation.at(best), -1.0, 1.0), -std::remainder(best, 2 * std::numbers::pi)};
}

Comparison ring_comparison(const RingLayout& layout, int64_t code_candidates) {
  if (layout.counts.size() > kRingFrequencies)
    throw UsageError("ring layout: expected at most ", kRingFrequencies, " frequencies, found ",
                     layout.counts.size());
  RingLayout whole = layout;
  whole.counts.resize(kRingFrequencies);
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
  rings.keys = [layout] { return std::make_unique<RingCodes>(layout); };
  rings.code_candidates = code_candidates;
  return rings;
}

}  // namespace revisit
