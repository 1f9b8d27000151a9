#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

namespace revisit {

/// Planar pose T_place_query that maximizes the top-down overlap of the query with cells of the
/// place: yaw `relative_yaw` +- 3 degrees [rad], shift up to `search_radius` along x and y [m].
/// Points [m] are within `range` of their sensor.
Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double relative_yaw,
                              double search_radius, double range);

}  // namespace revisit
