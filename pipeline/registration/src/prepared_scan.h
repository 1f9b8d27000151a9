#pragma once

#include <cmath>
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

}  // namespace revisit
