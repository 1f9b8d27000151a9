#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

namespace revisit::pipeline {

/// The level pose T_place_query under which most points of the query fall into cells of the place,
/// seen from above: turned by `turn` and up to 3 degrees more or less [rad], shifted by up to
/// `reach` along x and y [m]. Points [m] are within `range` of their sensor.
Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double turn, double reach,
                              double range);

}  // namespace revisit::pipeline
