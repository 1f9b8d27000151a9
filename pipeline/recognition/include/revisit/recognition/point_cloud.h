#pragma once

#include <cmath>
#include <vector>

namespace revisit {

/// LiDAR return in the sensor frame: x forward, y left, z up [m]. Memory layout of KITTI's .bin
/// files.
struct Point {
  float x = 0, y = 0, z = 0;  // [m]
  float intensity = 0;        // as in the file; the method ignores it
};

/// False for NaN, infinity and the origin: beams without a return, which every stage skips.
inline bool is_return(const Point& point) {
  return std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z) &&
         (point.x != 0 || point.y != 0 || point.z != 0);
}

/// Points of one revolution of the sensor, including those without a return.
struct PointCloud {
  std::vector<Point> points;
  std::vector<float> times;  // [points], relative to the scan's stamp [s]; empty: unknown
};

/// `[points][4]`: x, y, z, intensity.
inline const float* as_floats(const PointCloud& cloud) {
  static_assert(sizeof(Point) == 4 * sizeof(float));
  return cloud.points.empty() ? nullptr : &cloud.points.front().x;
}

}  // namespace revisit
