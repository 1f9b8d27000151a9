#pragma once

#include <cstddef>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// View of a scan's points in the memory of a driver or another library: floats x, y, z in the
/// sensor frame [m], `stride` bytes from one point to the next. It does not own the memory.
///
///   sensor_msgs::msg::PointCloud2 m;  PointsView{m.data.data(), m.width * m.height, m.point_step}
///   pcl::PointCloud<pcl::PointXYZ> c; PointsView{c.data(), c.size(), sizeof(pcl::PointXYZ)}
///   Eigen::Matrix3Xf p;               PointsView{p.data(), size_t(p.cols()), 3 * sizeof(float)}
struct PointsView {
  const void* data = nullptr;
  size_t count = 0;
  size_t stride = sizeof(Point);
  size_t x = 0, y = sizeof(float), z = 2 * sizeof(float);  // offsets in a point [bytes]
};

inline PointsView view_of(const PointCloud& cloud) {
  return {cloud.points.data(), cloud.points.size()};
}

/// Copies points to `cloud` and reuses its memory. Throws UsageError for offsets beyond the stride.
void copy_points(const PointsView& points, PointCloud& cloud);

}  // namespace revisit
