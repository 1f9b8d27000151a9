#pragma once

#include <Eigen/Geometry>
#include <string>
#include <string_view>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Points of a map entry, with x forward, y left and z up.
struct StoredCloud {
  PointCloud cloud;
  Eigen::Isometry3d mount;  // transforms points from the sensor's frame to this frame
};

/// Mean of the points of each voxel of edge `voxel` [m], within `range` [m].
PointCloud thinned_cloud(const PointCloud& cloud, double voxel, double range);

/// About 20 kB: the mean of each voxel of 0.4 m within 60 m, quantized to 1/32 m.
std::string compact_cloud(const PointCloud& cloud,
                          const Eigen::Isometry3d& mount = Eigen::Isometry3d::Identity());

/// Decodes compact_cloud(). Throws InputError for other bytes.
StoredCloud expand_cloud(std::string_view bytes);

}  // namespace revisit
