#pragma once

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Half a turn about z, without rounding.
inline PointCloud turned_by_half(PointCloud cloud) {
  for (Point& p : cloud.points) p = {-p.x, -p.y, p.z, p.intensity};
  return cloud;
}

}  // namespace revisit
