#pragma once

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Exceeds the range of any LiDAR; bounds voxel indices and moments.
inline constexpr float kMaxRange = 1000;  // [m]

inline bool is_near_return(const Point& point) {
  return is_return(point) &&
         std::max({std::abs(point.x), std::abs(point.y), std::abs(point.z)}) <= kMaxRange;
}

/// `Cloud` is a pcl::PointCloud.
template <class Cloud>
typename Cloud::Ptr to_pcl(const PointCloud& cloud) {
  typename Cloud::Ptr points(new Cloud);
  for (const Point& point : cloud.points) {
    if (!is_near_return(point)) continue;
    typename Cloud::PointType copy;
    copy.x = point.x;
    copy.y = point.y;
    copy.z = point.z;
    points->push_back(copy);
  }
  return points;
}

/// Sizes of M2DP, those of its paper.
inline constexpr int kM2dpAzimuths = 4, kM2dpElevations = 16;  // p, q: directions of the planes
inline constexpr int kM2dpCircles = 8, kM2dpSectors = 16;      // l, t: bins of each plane
inline constexpr int kM2dpPlanes = kM2dpAzimuths * kM2dpElevations;
inline constexpr int kM2dpBins = kM2dpCircles * kM2dpSectors;
inline constexpr int kM2dpDim = kM2dpPlanes + kM2dpBins;  // 192

/// Signature matrix A [planes][bins]: fraction of the points in each bin of each plane. Points are
/// centered and rotated to their principal axes; those beyond 1 km are ignored. Throws InputError
/// if none is left.
std::vector<double> m2dp_signatures(const PointCloud& cloud);

/// Descriptor [192]: first left and right singular vectors of A, both non-negative.
void m2dp(const PointCloud& cloud, std::span<float> descriptor);

}  // namespace revisit
