#include "revisit/recognition/align.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "align/moments.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

constexpr const char* kAlignCases[] = {"none", "case1", "case2"};

/// Two passes, because the sums of one pass cancel for a cloud far from the origin. The mean is
/// relative to the first point, so that equal points give exactly zero.
Eigen::Matrix3d covariance_of(const PointCloud& cloud) {
  const auto first = std::find_if(cloud.points.begin(), cloud.points.end(), is_return);
  const std::array<double, 3> start =
      first == cloud.points.end()
          ? std::array<double, 3>{}
          : std::array{double{first->x}, double{first->y}, double{first->z}};
  const size_t n = cloud.points.size();
  const auto [count, x, y, z] = first_moments(as_floats(cloud), n, start);
  if (count < 3)
    throw InputError("alignment needs at least 3 usable points, found ", count, " among ", n,
                     " (the others are NaN or at the sensor's origin)");

  const std::array mean{start[0] + x / count, start[1] + y / count, start[2] + z / count};
  const auto [xx, xy, xz, yy, yz, zz] = second_moments(as_floats(cloud), n, mean);
  Eigen::Matrix3d covariance;
  covariance << xx, xy, xz,  //
      xy, yy, yz,            //
      xz, yz, zz;
  return covariance / count;
}

/// Flips the direction if needed, so that the first non-zero of the given components is positive.
Eigen::Vector3d signed_by(const Eigen::Vector3d& v, int first, int second, int third) {
  for (const int component : {first, second, third})
    if (v[component] != 0) return v[component] > 0 ? v : Eigen::Vector3d(-v);
  return v;
}

}  // namespace

Alignment principal_alignment(const PointCloud& cloud, AlignCase which) {
  const Eigen::Matrix3d covariance = covariance_of(cloud);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);  // ascending
  const double l1 = solver.eigenvalues()[2], l2 = solver.eigenvalues()[1];
  if (!(l1 > 0)) throw InputError("alignment needs different points: all usable ones are the same");

  const Eigen::Vector3d z = signed_by(solver.eigenvectors().col(0), 2, 1, 0);
  const Eigen::Vector3d x = signed_by(solver.eigenvectors().col(2), 0, 1, 2);
  const Eigen::Vector3d y = z.cross(x);

  // Case 2 is exact, because only signs change.
  const double sign = which == AlignCase::kTwo ? -1 : 1;
  Alignment alignment;
  alignment.R_aligned_sensor.row(0) = (sign * x).cast<float>();
  alignment.R_aligned_sensor.row(1) = (sign * y).cast<float>();
  alignment.R_aligned_sensor.row(2) = z.cast<float>();
  alignment.eigenvalues = solver.eigenvalues().reverse().cwiseMax(0).cast<float>();
  alignment.eigenvalue_ratio =
      l2 > 0 ? static_cast<float>(l1 / l2) : std::numeric_limits<float>::infinity();
  alignment.abs_t11 = static_cast<float>(std::abs(x.x()));
  alignment.mirrored_choice = y.y() < 0;
  alignment.yaw = static_cast<float>(std::atan2(sign * x.y(), sign * x.x()));
  return alignment;
}

PointCloud rotated(const PointCloud& cloud, const Eigen::Matrix3f& R) {
  PointCloud result;
  result.points.reserve(cloud.points.size());
  for (const Point& p : cloud.points)
    result.points.push_back({R(0, 0) * p.x + R(0, 1) * p.y + R(0, 2) * p.z,
                             R(1, 0) * p.x + R(1, 1) * p.y + R(1, 2) * p.z,
                             R(2, 0) * p.x + R(2, 1) * p.y + R(2, 2) * p.z, p.intensity});
  return result;
}

AlignCase parse_align_case(const std::string& text) {
  for (size_t i = 0; i < std::size(kAlignCases); ++i)
    if (text == kAlignCases[i]) return static_cast<AlignCase>(i);
  throw UsageError("alignment: expected none, case1 or case2, found '" + text + "'");
}

const char* name_of(AlignCase mode) {
  return kAlignCases[static_cast<size_t>(mode)];
}

}  // namespace revisit
