#pragma once

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>

#include <cmath>
#include <vector>

#include "revisit/registration/registration.h"

namespace revisit::pipeline {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Tree = pcl::search::KdTree<pcl::PointXYZ>;
/// As PCL's GICP takes them.
using Covariances = std::vector<Eigen::Matrix3d, Eigen::aligned_allocator<Eigen::Matrix3d>>;

/// Fewer points are not a scan: neither normals nor a pose mean anything.
constexpr size_t kLeastPoints = 100;

/// With fewer than kLeastPoints points there is no more than the points.
struct PreparedScan::Parts {
  double range = 0;                          // that no point is beyond [m]
  Points::Ptr points;                        // one a voxel: the mean of its points
  Tree::Ptr tree;                            // of `points`
  std::vector<Eigen::Vector3f> normals;      // [point], of either sign
  pcl::shared_ptr<Covariances> covariances;  // [point], flat along the normal [m^2]
  std::vector<Eigen::Vector3f> upright;      // points of surfaces that stand rather than lie
};

/// Whether a normal is that of a surface that stands rather than lies.
inline bool is_upright(const Eigen::Vector3f& normal) {
  return std::abs(normal.z()) < 0.5F;
}

}  // namespace revisit::pipeline
