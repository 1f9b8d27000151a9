#pragma once

#include <Eigen/Geometry>
#include <optional>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// The ground around a sensor, as a plane in the sensor frame.
struct Ground {
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();  // unit normal, away from the ground
  double sensor_height = 0;                       // of the sensor above the plane [m]
};

/// The plane through the lowest points within 10 m: cells of 2 x 2 m give the height that 5 % of
/// their points lie below; reweighted least squares leave out other cells. Nothing if fewer than 12
/// cells, or a third of all, lie within 0.2 m of it, or if it tilts by more than 20 degrees.
std::optional<Ground> find_ground(const PointCloud& cloud);

/// Makes the ground horizontal, `sensor_height` [m] below: the shortest turn and a shift along z.
Eigen::Isometry3f T_level_sensor(const Ground& ground, double sensor_height);

/// The returns of a scan, levelled by the ground that it shows; as they are when it shows none, or
/// when they are within 1.5 degrees and 0.25 m of level.
PointCloud level(const PointCloud& cloud, double sensor_height);

}  // namespace revisit::pipeline
