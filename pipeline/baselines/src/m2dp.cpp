#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>

#include "point_features.h"
#include "revisit/base/error.h"
#include "revisit/baselines/baselines.h"
#include "revisit/recognition/matrix.h"

namespace revisit {
namespace {

/// Points relative to their centroid in principal axes, stored per coordinate.
struct AlignedPoints {
  std::vector<float> x, y, z;  // [m]
  float radius = 0;            // maximum distance from the centroid [m]
};

/// Right-handed axes in rows: x' has the largest variance, then y'. Their signs make the third
/// moments positive, so that the axes rotate with the cloud.
Eigen::Matrix3d principal_axes(const std::vector<Eigen::Vector3d>& centered) {
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : centered) scatter += p * p.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);  // ascending
  const auto toward_tail = [&](const Eigen::Vector3d& axis) -> Eigen::Vector3d {
    double third_moment = 0;
    for (const Eigen::Vector3d& p : centered) {
      const double along = axis.dot(p);
      third_moment += along * along * along;
    }
    return third_moment < 0 ? -axis : axis;
  };
  Eigen::Matrix3d axes;
  const Eigen::Vector3d x = toward_tail(solver.eigenvectors().col(2));
  const Eigen::Vector3d y = toward_tail(solver.eigenvectors().col(1));
  axes.row(0) = x;
  axes.row(1) = y;
  axes.row(2) = x.cross(y);
  return axes;
}

AlignedPoints align_points(const PointCloud& cloud) {
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Point& point : cloud.points)
    if (is_near_return(point)) {
      points.emplace_back(point.x, point.y, point.z);
      sum += points.back();
    }
  if (points.empty()) throw InputError("M2DP: no points to describe");
  const Eigen::Vector3d centroid = sum / static_cast<double>(points.size());
  for (Eigen::Vector3d& p : points) p -= centroid;

  const Eigen::Matrix3d axes = principal_axes(points);
  AlignedPoints aligned;
  double largest = 0;
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3d turned = axes * p;
    aligned.x.push_back(static_cast<float>(turned.x()));
    aligned.y.push_back(static_cast<float>(turned.y()));
    aligned.z.push_back(static_cast<float>(turned.z()));
    largest = std::max(largest, p.squaredNorm());
  }
  aligned.radius = static_cast<float>(std::sqrt(largest));
  return aligned;
}

double angle(int i, int count, double first, double last) {
  return first + (last - first) * i / (count - 1);
}

/// Axes of a plane: u is the x' axis projected onto it, v = normal x u.
struct PlaneAxes {
  Eigen::Vector3f u, v;
};
PlaneAxes plane_axes(double azimuth, double elevation) {
  const Eigen::Vector3d normal(std::cos(elevation) * std::cos(azimuth),
                               std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Eigen::Vector3d u = Eigen::Vector3d::UnitX() - normal.x() * normal;
  const Eigen::Vector3d v = normal.cross(u);
  return {u.cast<float>(), v.cast<float>()};
}

/// Sector of a direction, 22.5 degrees each from -pi, by comparing slopes instead of atan2.
int sector_of(float px, float py) {
  constexpr float kSlope = 0.414213562F;  // tan(22.5 deg)
  const float ax = std::abs(px), ay = std::abs(py);
  const int within = int{ay > kSlope * ax} + int{ay > ax} + int{kSlope * ay > ax};
  // Angles increase away from the x axis in the first and third quadrant, toward it in the others.
  const int up = px >= 0 ? 8 + within : 15 - within;
  const int down = px >= 0 ? 7 - within : within;
  return py >= 0 ? up : down;
}

void count_points(const AlignedPoints& points, const PlaneAxes& axes,
                  std::array<int, kM2dpBins>& counts) {
  // Circle k ends at the radius (k / l)^2 times the maximum.
  std::array<float, kM2dpCircles - 1> squared_ends{};
  for (int k = 1; k < kM2dpCircles; ++k)
    squared_ends[static_cast<size_t>(k - 1)] = static_cast<float>(
        std::pow(points.radius * std::pow(static_cast<double>(k) / kM2dpCircles, 2), 2));
  // Bins and counts in separate loops, so that the compiler vectorizes the first.
  constexpr size_t kBlock = 1024;
  std::array<int, kBlock> bins{};
  for (size_t first = 0; first < points.x.size(); first += kBlock) {
    const size_t count = std::min(kBlock, points.x.size() - first);
    for (size_t at = 0; at < count; ++at) {
      const size_t i = first + at;
      const float px =
          points.x[i] * axes.u.x() + points.y[i] * axes.u.y() + points.z[i] * axes.u.z();
      const float py =
          points.x[i] * axes.v.x() + points.y[i] * axes.v.y() + points.z[i] * axes.v.z();
      const float squared = px * px + py * py;
      int circle = 0;
      for (const float end : squared_ends) circle += int{squared >= end};
      bins[at] = circle * kM2dpSectors + sector_of(px, py);
    }
    for (size_t at = 0; at < count; ++at) ++counts[static_cast<size_t>(bins[at])];
  }
}

}  // namespace

std::vector<double> m2dp_signatures(const PointCloud& cloud) {
  const AlignedPoints points = align_points(cloud);
  constexpr double kRight = std::numbers::pi / 2;
  std::vector<double> signatures;
  for (int p = 0; p < kM2dpAzimuths; ++p)
    for (int q = 0; q < kM2dpElevations; ++q) {
      std::array<int, kM2dpBins> counts{};
      count_points(points,
                   plane_axes(angle(p, kM2dpAzimuths, -kRight, kRight),
                              angle(q, kM2dpElevations, 0, kRight)),
                   counts);
      for (const int count : counts)
        signatures.push_back(count / static_cast<double>(points.x.size()));
    }
  return signatures;
}

void m2dp(const PointCloud& cloud, std::span<float> descriptor) {
  const std::vector<double> signatures = m2dp_signatures(cloud);  // A [kM2dpPlanes][kM2dpBins]
  // The left singular vectors of A are eigenvectors of A A^T, 64 x 64. It is non-negative, and so
  // is its first eigenvector, up to the sign (Perron-Frobenius).
  std::vector<double> squares(int64_t{kM2dpPlanes} * kM2dpPlanes);
  multiply_transposed(kM2dpPlanes, kM2dpPlanes, kM2dpBins, signatures.data(), kM2dpBins,
                      signatures.data(), kM2dpBins, squares.data(), kM2dpPlanes);
  const std::vector<double> left = largest_eigenpairs(squares, kM2dpPlanes, 1).vectors;
  std::array<double, kM2dpBins> right{};
  for (size_t plane = 0; plane < kM2dpPlanes; ++plane)
    for (size_t bin = 0; bin < kM2dpBins; ++bin)
      right[bin] += std::abs(left[plane]) * signatures[plane * kM2dpBins + bin];
  const double length =
      std::sqrt(std::inner_product(right.begin(), right.end(), right.begin(), 0.0));
  const auto rest = std::ranges::transform(
      left, descriptor.begin(), [](double v) { return static_cast<float>(std::abs(v)); });
  std::ranges::transform(right, rest.out,
                         [length](double v) { return static_cast<float>(v / length); });
}

FeatureExtractor m2dp_features() {
  const auto make = []() -> FeatureFunction<PointCloud> { return m2dp; };
  return {.name = "m2dp", .key = "m2dp", .dim = kM2dpDim, .make = make};
}

}  // namespace revisit
