#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <array>
#include <cstdint>
#include <unordered_map>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

using Voxel = std::array<int32_t, 3>;
/// Voxel of a point; `edge` must be at least kMinRadius, so that indices fit in 21 bits.
Voxel voxel_of(const pcl::PointXYZ& point, float edge);
uint64_t voxel_key(const Voxel& voxel);

inline constexpr double kMinRadius = 0.001, kMaxRadius = 10;  // [m]
void check_radius(const char* what, double radius);

/// Points and as many surface normals, oriented toward the sensor.
struct Surface {
  pcl::PointCloud<pcl::PointXYZ>::Ptr points;
  pcl::PointCloud<pcl::Normal>::Ptr normals;
};
/// Points with at least 3 points within `radius`, including themselves. Throws InputError for a
/// scan so dense that its neighborhoods, up to the caller's `largest_radius`, would take hours.
Surface surface_of(const PointCloud& cloud, double radius, double largest_radius);

}  // namespace revisit
