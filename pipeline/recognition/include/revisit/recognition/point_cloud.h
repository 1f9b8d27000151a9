#pragma once

#include <cmath>
#include <vector>

namespace revisit::pipeline {

/// One LiDAR return. Sensor frame: x forward, y left, z up [m]; the layout of KITTI's .bin files.
struct Point {
  float x = 0, y = 0, z = 0;  // [m]
  float intensity = 0;        // as the file gives it, unused by the method
};

/// False for a beam without return: NaN, infinity or the origin. Every stage skips those points.
inline bool is_return(const Point& point) {
  return std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z) &&
         (point.x != 0 || point.y != 0 || point.z != 0);
}

/// One revolution of the sensor. Points without a return stay, so that files pass unchanged.
struct PointCloud {
  std::vector<Point> points;
  std::vector<float> times;  // of the points, from the scan's stamp on [s]; none: not known
};

/// The points as floats `[points][4]`: x, y, z, intensity, as a Point lies in memory.
inline const float* as_floats(const PointCloud& cloud) {
  static_assert(sizeof(Point) == 4 * sizeof(float));
  return cloud.points.empty() ? nullptr : &cloud.points.front().x;
}

}  // namespace revisit::pipeline
