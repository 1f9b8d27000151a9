#pragma once

#include <Eigen/Geometry>
#include <string>
#include <string_view>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// The points of a place, with x forward, y left and z up.
struct StoredCloud {
  PointCloud cloud;
  Eigen::Isometry3d mount;  // takes points as the sensor gave them there
};

/// The mean of each voxel of the points within `range` [m].
PointCloud thinned_cloud(const PointCloud& cloud, double voxel, double range);

/// The points of a scan for later registrations, in some 20 kB: the mean of each voxel of 0.4 m
/// within 60 m, in steps of 1/32 m.
std::string compact_cloud(const PointCloud& cloud,
                          const Eigen::Isometry3d& mount = Eigen::Isometry3d::Identity());

/// What compact_cloud() kept. Throws InputError for other bytes.
StoredCloud expand_cloud(std::string_view bytes);

}  // namespace revisit::pipeline
