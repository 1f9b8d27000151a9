#pragma once

#include <algorithm>
#include <cmath>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Exceeds the range of any LiDAR; bounds voxel indices and moments.
inline constexpr float kMaxRange = 1000;  // [m]

inline bool is_near_return(const Point& point) {
  return is_return(point) &&
         std::max({std::abs(point.x), std::abs(point.y), std::abs(point.z)}) <= kMaxRange;
}

}  // namespace revisit
