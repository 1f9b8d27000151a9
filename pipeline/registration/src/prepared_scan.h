#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "nearest_neighbors.h"
#include "revisit/registration/registration.h"

namespace revisit {

/// With fewer points, normals and poses are meaningless.
constexpr size_t kMinPoints = 100;

/// Only `range` and `points` are set if there are fewer than kMinPoints points.
struct PreparedScan::Parts {
  double range = 0;  // [m]
  std::vector<Eigen::Vector3f> points;
  std::optional<NearestNeighbors> tree;
  std::vector<Eigen::Vector3f> normals;  // [point], of either sign
  std::vector<Eigen::Vector3f> upright;  // points with near-horizontal normals (non-ground)
};

void check(const RegistrationOptions& options);

/// Voxel means within `range` [m]. The order of the input affects only rounding.
std::vector<Eigen::Vector3f> thinned(const PointCloud& cloud, double voxel, double range);

inline bool is_non_ground(const Eigen::Vector3f& normal) {
  return std::abs(normal.z()) < 0.5F;
}

/// Planar pose T_place_query that maximizes the top-down overlap of the query with cells of the
/// place: yaw `relative_yaw` +- 3 degrees [rad], shift up to `search_radius` along x and y [m].
/// Points [m] are within `range` of their sensor.
Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double relative_yaw,
                              double search_radius, double range);

}  // namespace revisit
