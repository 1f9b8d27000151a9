#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <cmath>

#include "revisit/pipeline/point_cloud.h"

namespace revisit::pipeline {

/// No LiDAR sees farther. Bounds what is computed from coordinates, voxel indices for example.
inline constexpr float kFarthest = 1000;  // [m]

/// The returns of a scan as PCL takes them.
template <class PclPoint>
typename pcl::PointCloud<PclPoint>::Ptr to_pcl(const PointCloud& cloud) {
  typename pcl::PointCloud<PclPoint>::Ptr points(new pcl::PointCloud<PclPoint>);
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    if (std::max({std::abs(point.x), std::abs(point.y), std::abs(point.z)}) > kFarthest) continue;
    PclPoint copy;
    copy.x = point.x;
    copy.y = point.y;
    copy.z = point.z;
    points->push_back(copy);
  }
  return points;
}

}  // namespace revisit::pipeline
