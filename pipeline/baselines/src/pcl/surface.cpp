#include "pcl/surface.h"

#include <pcl/console/print.h>
#include <pcl/features/feature.h>
#include <pcl/search/kdtree.h>

#include <pcl/features/impl/feature.hpp>
#include <pcl/features/impl/normal_3d.hpp>

#include "pcl/clouds.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;

/// Bounds the work by the number of pairs of points in a voxel of edge `radius`.
void check_density(const Points& points, double radius) {
  constexpr double kMaxPairs = 1e9;  // a scan of an HDL-64 has a few million
  std::unordered_map<uint64_t, double> counts;
  const auto edge = static_cast<float>(radius);
  for (const pcl::PointXYZ& point : points) ++counts[voxel_key(voxel_of(point, edge))];
  double pairs = 0;
  for (const auto& [key, count] : counts) pairs += count * count;
  if (pairs > kMaxPairs)
    throw InputError("the points are too dense for a neighborhood of ", radius,
                     " m: ", points.size(), " points, ", pairs,
                     " pairs of neighbors; downsample the scan or use a smaller radius");
}

}  // namespace

Voxel voxel_of(const pcl::PointXYZ& point, float edge) {
  const float inverse = 1 / edge;  // as pcl::VoxelGrid computes it
  return {static_cast<int32_t>(std::floor(point.x * inverse)),
          static_cast<int32_t>(std::floor(point.y * inverse)),
          static_cast<int32_t>(std::floor(point.z * inverse))};
}

uint64_t voxel_key(const Voxel& voxel) {
  uint64_t key = 0;
  for (const int32_t index : voxel) key = key << 21 | (static_cast<uint64_t>(index) & 0x1FFFFF);
  return key;
}

void check_radius(const char* what, double radius) {
  if (!(radius >= kMinRadius && radius <= kMaxRadius))
    throw UsageError(what, ": expected a radius of ", kMinRadius, " to ", kMaxRadius, " m, found ",
                     radius);
}

Surface surface_of(const PointCloud& cloud, double radius, double largest_radius) {
  // Errors are reported as exceptions instead.
  [[maybe_unused]] static const bool silent = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  const Points::Ptr points = to_pcl<pcl::PointXYZ>(cloud);
  check_density(*points, largest_radius);
  pcl::PointCloud<pcl::Normal> normals;
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(pcl::search::KdTree<pcl::PointXYZ>::Ptr(
      new pcl::search::KdTree<pcl::PointXYZ>(/*sorted=*/false)));
  estimation.setRadiusSearch(radius);
  if (!points->empty()) estimation.compute(normals);

  Surface surface{Points::Ptr(new Points),
                  pcl::PointCloud<pcl::Normal>::Ptr(new pcl::PointCloud<pcl::Normal>)};
  for (size_t i = 0; i < normals.size(); ++i) {
    const pcl::Normal& normal = normals[i];
    if (!std::isfinite(normal.normal_x + normal.normal_y + normal.normal_z)) continue;
    surface.points->push_back((*points)[i]);
    surface.normals->push_back(normal);
  }
  return surface;
}

}  // namespace revisit
