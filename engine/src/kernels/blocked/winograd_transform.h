#pragma once

#include <array>
#include <cstddef>

namespace revisit::engine {

/// Interpolation points of polynomials: 0, pairs +p, -p, and infinity. For an odd number all points
/// are finite; for an even number the last entry is unused and stands for infinity. All powers that
/// are needed are exact in float32. Among symmetric sets of eighths, they minimize the
/// amplification of rounding errors: the sum over points |row of input| |row of weights| |column of
/// output|, averaged over outputs (Barabasz et al. 2020, "Error analysis and improving the accuracy
/// of Winograd convolution").
template <int kPoints>
constexpr std::array<double, kPoints> winograd_points() {
  constexpr bool kOdd = kPoints % 2 == 1;
  constexpr auto kPairs = [] {
    if constexpr (kPoints == 4) return std::array{1.0};
    if constexpr (kPoints == 5) return std::array{0.75, 3.0};
    if constexpr (kPoints == 6) return std::array{0.625, 1.5};
    if constexpr (kPoints == 7) return std::array{0.625, 1.125, 3.0};
    if constexpr (kPoints == 8) return std::array{0.5, 1.0, 2.0};
    if constexpr (kPoints == 9) return std::array{0.5, 0.875, 1.5, 3.5};
    if constexpr (kPoints == 10) return std::array{0.5, 0.875, 1.125, 2.25};
  }();
  static_assert(kPairs.size() == (kPoints - (kOdd ? 1 : 2)) / 2);
  std::array<double, kPoints> points{};
  for (size_t i = 0; i < kPairs.size(); ++i) {
    points[1 + 2 * i] = kPairs[i];
    points[2 + 2 * i] = -kPairs[i];
  }
  return points;
}

/// Matrices of F(m, r): m outputs of a correlation with r taps from m + r - 1 inputs and as many
/// multiplications, `output * ((weights * g) . (input * d))`. They transpose Toom-Cook's
/// multiplication of polynomials (Winograd 1980, "Arithmetic complexity of computations"; Lavin and
/// Gray 2016, "Fast algorithms for convolutional neural networks"): evaluate at the points,
/// multiply, interpolate.
template <int kOutputCount, int kTapCount>
struct WinogradTransform {
  static constexpr int kOutputs = kOutputCount, kTaps = kTapCount;
  static constexpr int kPoints = kOutputs + kTaps - 1;
  static constexpr bool kHasInfinity = kPoints % 2 == 0;
  static constexpr int kFinite = kHasInfinity ? kPoints - 1 : kPoints;
  static constexpr int kPairs = (kFinite - 1) / 2;
  static constexpr auto kAt = winograd_points<kPoints>();

  static constexpr double power(double base, int exponent) {
    double result = 1;
    for (int i = 0; i < exponent; ++i) result *= base;
    return result;
  }

  /// Rows of the Vandermonde matrix; infinity selects the highest power.
  static constexpr auto kOutput = [] {
    std::array<std::array<double, kPoints>, kOutputs> m{};
    for (int j = 0; j < kOutputs; ++j) {
      for (int i = 0; i < kFinite; ++i) m[j][i] = power(kAt[i], j);
      if (kHasInfinity) m[j][kPoints - 1] = j == kOutputs - 1 ? 1 : 0;
    }
    return m;
  }();

  /// Vandermonde matrix with each row divided by the denominator of its Lagrange polynomial.
  static constexpr auto kWeights = [] {
    std::array<std::array<double, kTaps>, kPoints> m{};
    for (int i = 0; i < kFinite; ++i) {
      double denominator = 1;
      for (int q = 0; q < kFinite; ++q)
        if (q != i) denominator *= kAt[i] - kAt[q];
      for (int k = 0; k < kTaps; ++k) m[i][k] = power(kAt[i], k) / denominator;
    }
    if (kHasInfinity) m[kPoints - 1][kTaps - 1] = 1;
    return m;
  }();

  /// Coefficients of numerators: row i is the product of (x - p) over finite points p but point i.
  static constexpr auto kInput = [] {
    std::array<std::array<double, kPoints>, kPoints> m{};
    for (int i = 0; i < kPoints; ++i) {
      auto& row = m[i];
      row[0] = 1;
      int degree = 0;
      for (int q = 0; q < kFinite; ++q) {
        if (q == i) continue;
        ++degree;
        for (int k = degree; k > 0; --k) row[k] = row[k - 1] - kAt[q] * row[k];
        row[0] *= -kAt[q];
      }
    }
    return m;
  }();
};

}  // namespace revisit::engine
