#include "align/facets.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace revisit {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

/// Flat patch: the points in one direction from the sensor.
struct Facet {
  Eigen::Vector3d normal, middle;
  double weight;  // inverse variance of the normal's direction [1/rad^2]

  /// Squared sine of the angle by which the patch is neither parallel nor perpendicular to `up`.
  double misfit(const Eigen::Vector3d& up) const {
    const double cosine = normal.dot(up);
    return std::min(cosine * cosine, 1 - cosine * cosine);
  }
};

struct Moments {
  int count = 0;
  Eigen::Vector3d first, sum = Eigen::Vector3d::Zero();  // `sum`, `squares`: relative to `first`
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
};

std::optional<Facet> facet_of(const Moments& cell) {
  constexpr int kMinPoints = 8;
  constexpr double kRange = 0.01, kThickness = 0.05, kMinWidth = 1e-3;  // standard deviations [m]
  constexpr double kModel = 1 * kDeg, kMaxDeviation = 10 * kDeg;        // of the normal
  if (cell.count < kMinPoints) return std::nullopt;
  const Eigen::Vector3d mean = cell.sum / cell.count;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(  // ascending
      cell.squares / cell.count - mean * mean.transpose());
  const double thickness = std::max(kRange * kRange, solver.eigenvalues()[0]);
  const double width = solver.eigenvalues()[1];
  if (thickness > kThickness * kThickness || width < kMinWidth * kMinWidth) return std::nullopt;
  const double variance = thickness / (cell.count * width);
  if (variance > kMaxDeviation * kMaxDeviation) return std::nullopt;
  return Facet{solver.eigenvectors().col(0), cell.first + mean, 1 / (variance + kModel * kModel)};
}

/// Cells are squares on the faces of a cube around the sensor, 6 to 8 degrees wide.
std::vector<Facet> facets_of(const PointCloud& cloud) {
  constexpr float kFar = 20, kTooNear = 0.3F;  // [m]
  constexpr int kAcross = 14;
  std::vector<Moments> cells(size_t{6} * kAcross * kAcross);
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const std::array v{point.x, point.y, point.z};
    const auto axis = static_cast<size_t>(
        std::ranges::max_element(v, {}, [](float c) { return std::abs(c); }) - v.begin());
    const float depth = std::abs(v[axis]);
    if (depth < kTooNear || depth > kFar) continue;
    const auto across = [&](size_t other) {
      const float tangent = v[other % 3] / depth;  // -1 .. 1
      return std::min(static_cast<int>((tangent + 1) * (kAcross / 2)), kAcross - 1);
    };
    const int face = static_cast<int>(2 * axis) + (v[axis] < 0 ? 1 : 0);
    Moments& cell = cells[static_cast<size_t>((face * kAcross + across(axis + 1)) * kAcross +
                                              across(axis + 2))];
    const Eigen::Vector3d p(point.x, point.y, point.z);
    if (cell.count++ == 0) cell.first = p;
    const Eigen::Vector3d d = p - cell.first;
    cell.sum += d;
    cell.squares += d * d.transpose();
  }
  std::vector<Facet> facets;
  for (const Moments& cell : cells)
    if (const std::optional<Facet> facet = facet_of(cell)) facets.push_back(*facet);
  return facets;
}

/// Most facets fit this direction, of those every 3 degrees.
Eigen::Vector3d voted_up(const std::vector<Facet>& facets) {
  constexpr double kStep = 3 * kDeg;
  constexpr int kSteps = 10;
  static const double kMisfit = std::pow(std::sin(2 * kStep), 2);
  Eigen::Vector3d best = Eigen::Vector3d::UnitZ();
  double most = 0;
  for (int row = -kSteps; row <= kSteps; ++row)
    for (int column = -kSteps; column <= kSteps; ++column) {
      if (row * row + column * column > kSteps * kSteps) continue;
      const Eigen::Vector3d up =
          Eigen::Vector3d(std::tan(kStep * row), std::tan(kStep * column), 1).normalized();
      double votes = 0;
      for (const Facet& facet : facets) {
        const double fit = std::max(0.0, 1 - facet.misfit(up) / kMisfit);
        votes += facet.weight * fit * fit;
      }
      if (votes > most) most = votes, best = up;
    }
  return best;
}

/// Depth of the largest floor below the sensor, else `usual`.
double floor_depth(const std::vector<Facet>& facets, const Eigen::Vector3d& up, double usual) {
  constexpr double kLeast = 0.2, kThickness = 0.15;  // [m]
  static const double kLevel = std::cos(6 * kDeg);
  std::vector<std::pair<double, double>> floors;  // depth [m], weight
  for (const Facet& facet : facets)
    if (const double depth = -facet.middle.dot(up);
        depth > kLeast && std::abs(facet.normal.dot(up)) > kLevel)
      floors.emplace_back(depth, facet.weight);
  double most = 0, best = usual;
  for (const auto& [depth, unused] : floors) {
    double weights = 0, sum = 0;
    for (const auto& [other, weight] : floors)
      if (std::abs(other - depth) < kThickness) {
        weights += weight;
        sum += weight * other;
      }
    if (weights > most) most = weights, best = sum / weights;
  }
  return best;
}

}  // namespace

std::optional<Ground> find_upright(const PointCloud& cloud, double sensor_height) {
  constexpr size_t kMinFacets = 20;
  constexpr int kRounds = 12;
  constexpr double kMinAgreement = 0.4, kNarrower = 0.8;
  constexpr double kWide = 6 * kDeg, kNarrow = 2 * kDeg, kUsualTilt = 15 * kDeg;
  const std::vector<Facet> facets = facets_of(cloud);
  if (facets.size() < kMinFacets) return std::nullopt;
  Eigen::Vector3d up = voted_up(facets);
  double scale = kWide, agreeing = 0, all = 0;
  for (int round = 0; round < kRounds; ++round, scale = std::max(kNarrow, kNarrower * scale)) {
    // Minimizes the weighted squares of the sines of walls and of the cosines of floors.
    Eigen::Matrix3d squares = Eigen::Vector3d(1, 1, 0).asDiagonal();
    squares /= kUsualTilt * kUsualTilt;
    agreeing = all = 0;
    for (const Facet& facet : facets) {
      const double misfit = facet.misfit(up) / (scale * scale), cosine = facet.normal.dot(up);
      const double weight = facet.weight / ((1 + misfit) * (1 + misfit));
      squares +=
          (cosine * cosine < 0.5 ? weight : -weight) * facet.normal * facet.normal.transpose();
      all += facet.weight;
      if (misfit < 4) agreeing += facet.weight;
    }
    up = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(squares).eigenvectors().col(0);
    if (up.z() < 0) up = -up;
  }
  if (agreeing < kMinAgreement * all) return std::nullopt;
  return Ground{up, floor_depth(facets, up, sensor_height)};
}

}  // namespace revisit
