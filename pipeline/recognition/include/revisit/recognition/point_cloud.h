#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace revisit {

/// LiDAR return in the sensor frame: x forward, y left, z up [m]. Memory layout of KITTI's .bin
/// files.
struct Point {
  float x = 0, y = 0, z = 0;  ///< [m]
  float intensity = 0;        ///< as in the file; the method ignores it
};

/// False for NaN, infinity and the origin: beams without a return, which every stage skips.
inline bool is_return(const Point& point) {
  return std::isfinite(point.x) && std::isfinite(point.y) && std::isfinite(point.z) &&
         (point.x != 0 || point.y != 0 || point.z != 0);
}

/// Points of one revolution of the sensor, including those without a return.
struct PointCloud {
  std::vector<Point> points;  ///< in the order of the file
  std::vector<float> times;   ///< [points], relative to the scan's stamp [s]; empty: unknown
};

/// `[points][4]`: x, y, z, intensity.
inline const float* as_floats(const PointCloud& cloud) {
  static_assert(sizeof(Point) == 4 * sizeof(float));
  return cloud.points.empty() ? nullptr : &cloud.points.front().x;
}

/// View of a scan's points in the memory of a driver or another library: x, y, z in the sensor
/// frame [m], float or double, `stride` bytes from one point to the next. It does not own the
/// memory.
///
///   sensor_msgs::msg::PointCloud2 m;  PointsView{m.data.data(), m.width * m.height, m.point_step}
///   pcl::PointCloud<pcl::PointXYZ> c; PointsView{c.data(), c.size(), sizeof(pcl::PointXYZ)}
///   Eigen::Matrix3Xf p;               PointsView{p.data(), size_t(p.cols()), 3 * sizeof(float)}
struct PointsView {
  const void* data = nullptr;                              ///< first point
  size_t count = 0;                                        ///< number of points
  size_t stride = sizeof(Point);                           ///< [bytes] from one point to the next
  size_t x = 0, y = sizeof(float), z = 2 * sizeof(float);  ///< offsets in a point [bytes]
  bool is_double = false;                                  ///< of the coordinates
};

/// View of all points, valid while `cloud` is unchanged.
inline PointsView view_of(const PointCloud& cloud) {
  return {cloud.points.data(), cloud.points.size()};
}

/// View of the points of KISS-ICP and others.
inline PointsView view_of(std::span<const Eigen::Vector3d> points) {
  constexpr size_t kBytes = sizeof(double);
  return {points.data(), points.size(), sizeof(Eigen::Vector3d), 0, kBytes, 2 * kBytes, true};
}

/// Copies points to `cloud` and reuses its memory. Throws UsageError for offsets beyond the stride.
void copy_points(const PointsView& points, PointCloud& cloud);

}  // namespace revisit
