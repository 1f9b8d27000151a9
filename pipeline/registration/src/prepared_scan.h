#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include "neighbours.h"
#include "revisit/registration/registration.h"

namespace revisit::pipeline {

/// Fewer points are not a scan: neither normals nor a pose mean anything.
constexpr size_t kLeastPoints = 100;

/// With fewer than kLeastPoints points there is no more than the points.
struct PreparedScan::Parts {
  double range = 0;                      // that no point is beyond [m]
  std::vector<Eigen::Vector3f> points;   // one a voxel: the mean of its points
  std::optional<Neighbours> tree;        // of `points`
  std::vector<Eigen::Vector3f> normals;  // [point], of either sign
  std::vector<Eigen::Vector3f> upright;  // points of surfaces that stand rather than lie
};

/// Throws UsageError, naming the invalid field.
void check(const RegistrationOptions& options);

/// The mean of the points of each voxel within `range` [m], in the order of voxels: that of the
/// file's points does not show, but for rounding.
std::vector<Eigen::Vector3f> thinned(const PointCloud& cloud, double voxel, double range);

/// Whether a normal is that of a surface that stands rather than lies.
inline bool is_upright(const Eigen::Vector3f& normal) {
  return std::abs(normal.z()) < 0.5F;
}

}  // namespace revisit::pipeline
