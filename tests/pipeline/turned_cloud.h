#pragma once

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// By half a turn about z, which rounds nothing.
inline PointCloud turned_by_half(PointCloud cloud) {
  for (Point& p : cloud.points) p = {-p.x, -p.y, p.z, p.intensity};
  return cloud;
}

}  // namespace revisit::pipeline
