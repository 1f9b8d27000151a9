#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include "near_return.h"

namespace revisit {

template <class PclPoint>
typename pcl::PointCloud<PclPoint>::Ptr to_pcl(const PointCloud& cloud) {
  typename pcl::PointCloud<PclPoint>::Ptr points(new pcl::PointCloud<PclPoint>);
  for (const Point& point : cloud.points) {
    if (!is_near_return(point)) continue;
    PclPoint copy;
    copy.x = point.x;
    copy.y = point.y;
    copy.z = point.z;
    points->push_back(copy);
  }
  return points;
}

}  // namespace revisit
