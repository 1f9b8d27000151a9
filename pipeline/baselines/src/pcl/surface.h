#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <array>
#include <cstdint>
#include <unordered_map>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// A cell of a cubic grid through the origin.
using Voxel = std::array<int32_t, 3>;
/// The voxel a point lies in; `edge` is at least kLeastRadius, so that indices fit 21 bits.
Voxel voxel_of(const pcl::PointXYZ& point, float edge);
/// A number of its own for each voxel.
uint64_t voxel_key(const Voxel& voxel);

inline constexpr double kLeastRadius = 0.001, kLargestRadius = 10;  // [m]
/// Throws UsageError, naming `what`, for a radius out of these bounds.
void check_radius(const char* what, double radius);

/// Points with their surface normals, which point towards the sensor; as many of each.
struct Surface {
  pcl::PointCloud<pcl::PointXYZ>::Ptr points;
  pcl::PointCloud<pcl::Normal>::Ptr normals;
};
/// The points with at least 3 points within `radius`, themselves counted. Throws InputError for a
/// scan so dense that its neighbourhoods, up to the caller's `largest_radius`, would take hours.
Surface surface_of(const PointCloud& cloud, double radius, double largest_radius);

}  // namespace revisit::pipeline
