#include "pcl/prepared_scan.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "check_options.h"

namespace revisit::pipeline {
namespace {

/// The mean of the points of each voxel, in the order of voxels: that of the file's points does not
/// show, but for rounding.
Points::Ptr thinned(const PointCloud& cloud, double voxel, double range) {
  struct Entry {
    uint64_t voxel;
    size_t point;
    bool operator<(const Entry& other) const {
      return std::tie(voxel, point) < std::tie(other.voxel, other.point);
    }
  };
  std::vector<Entry> entries;
  for (size_t i = 0; i < cloud.points.size(); ++i) {
    const Point& point = cloud.points[i];
    const Eigen::Vector3d p = Eigen::Vector3f(point.x, point.y, point.z).cast<double>();
    if (!is_return(point) || p.norm() > range) continue;
    uint64_t key = 0;
    for (const double x : {p.x(), p.y(), p.z()})
      key = key << 21 | static_cast<uint64_t>(std::floor((x + range) / voxel));
    entries.push_back({key, i});
  }
  std::sort(entries.begin(), entries.end());

  Points::Ptr points(new Points);
  for (size_t first = 0, last = 0; first < entries.size(); first = last) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (; last < entries.size() && entries[last].voxel == entries[first].voxel; ++last) {
      const Point& point = cloud.points[entries[last].point];
      sum += Eigen::Vector3f(point.x, point.y, point.z).cast<double>();
    }
    const Eigen::Vector3f mean = (sum / static_cast<double>(last - first)).cast<float>();
    points->push_back({mean.x(), mean.y(), mean.z()});
  }
  return points;
}

/// The direction in which the points spread least.
Eigen::Vector3d normal_of(const Points& points, const pcl::Indices& indices) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int i : indices)
    mean += points[static_cast<size_t>(i)].getVector3fMap().cast<double>();
  mean /= static_cast<double>(indices.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const int i : indices) {
    const Eigen::Vector3d p = points[static_cast<size_t>(i)].getVector3fMap().cast<double>() - mean;
    scatter += p * p.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().col(0);
}

}  // namespace

PreparedScan::PreparedScan(const PointCloud& cloud, const RegistrationOptions& options) {
  check(options);
  const auto parts = std::make_shared<Parts>();
  parts_ = parts;
  parts->range = options.max_range;
  parts->points = thinned(cloud, options.voxel, options.max_range);
  if (parts->points->size() < kLeastPoints) return;

  parts->tree.reset(new Tree);
  parts->tree->setInputCloud(parts->points);
  parts->covariances.reset(new Covariances);
  // Of the GICP paper.
  constexpr int kNeighbours = 20;
  constexpr double kFlatness = 1e-3;
  pcl::Indices neighbours;
  std::vector<float> squared_distances;
  for (const pcl::PointXYZ& point : *parts->points) {
    parts->tree->nearestKSearch(point, kNeighbours, neighbours, squared_distances);
    const Eigen::Vector3d normal = normal_of(*parts->points, neighbours);
    parts->normals.push_back(normal.cast<float>());
    parts->covariances->push_back(Eigen::Matrix3d::Identity() -
                                  (1 - kFlatness) * normal * normal.transpose());
    if (is_upright(parts->normals.back())) parts->upright.emplace_back(point.getVector3fMap());
  }
}

int64_t PreparedScan::size() const {
  return static_cast<int64_t>(parts_->points->size());
}

}  // namespace revisit::pipeline
