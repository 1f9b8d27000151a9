#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

struct Ground {
  Eigen::Vector3d up =
      Eigen::Vector3d::UnitZ();  // unit normal in the sensor frame, away from the ground
  double sensor_height = 0;      // above the plane [m]
  bool is_wide = false;          // it has cells on all sides, which fix its slope to 0.3 degrees
};

/// Fits a plane to the lowest points within 10 m by reweighted least squares: the 5 % height
/// quantile of each 2 x 2 m cell. Returns nothing if fewer than 12 cells, or fewer than a third,
/// lie within 0.2 m of the plane, or if it tilts by more than 20 degrees.
std::optional<Ground> find_ground(const PointCloud& cloud);

/// Returns the transform that makes the ground horizontal, `sensor_height` [m] below the sensor:
/// the smallest rotation, then a translation along z.
Eigen::Isometry3f T_level_sensor(const Ground& ground, double sensor_height);

/// Returns the gravity-aligned returns of a scan: a wide ground becomes horizontal, else walls and
/// floors are upright (find_upright), else a narrow ground is taken. They are unchanged if none is
/// found, or if it is within 1.5 degrees and 0.25 m of its nominal pose. A field that does not show
/// the ground nearby has walls and floors only: its lowest points are the edge of what it sees.
PointCloud level(const PointCloud& cloud, double sensor_height, bool shows_ground = true);

}  // namespace revisit
