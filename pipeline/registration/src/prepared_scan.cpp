#include "prepared_scan.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

void check(const char* name, double value, double least, double most) {
  if (!(value >= least && value <= most))
    throw UsageError(
        str("RegistrationOptions::", name, ": expected ", least, " to ", most, ", found ", value));
}

/// The mean of the points of each voxel, in the order of voxels: that of the file's points does not
/// show, but for rounding.
std::vector<Eigen::Vector3f> thinned(const PointCloud& cloud, double voxel, double range) {
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

  std::vector<Eigen::Vector3f> points;
  for (size_t first = 0, last = 0; first < entries.size(); first = last) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (; last < entries.size() && entries[last].voxel == entries[first].voxel; ++last) {
      const Point& point = cloud.points[entries[last].point];
      sum += Eigen::Vector3f(point.x, point.y, point.z).cast<double>();
    }
    points.emplace_back((sum / static_cast<double>(last - first)).cast<float>());
  }
  return points;
}

/// The direction in which the points spread least.
Eigen::Vector3f normal_of(const std::vector<Eigen::Vector3f>& points,
                          const std::vector<uint32_t>& indices) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const uint32_t i : indices) mean += points[i].cast<double>();
  mean /= static_cast<double>(indices.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const uint32_t i : indices) {
    const Eigen::Vector3d p = points[i].cast<double>() - mean;
    scatter += p * p.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter)
      .eigenvectors()
      .col(0)
      .cast<float>();
}

}  // namespace

void check(const RegistrationOptions& options) {
  check("voxel", options.voxel, 0.05, 5);
  check("max_range", options.max_range, 1, 200);
  check("reach", options.reach, 0, 20);
  check("max_distance", options.max_distance, 0.01, 20);
  check("inlier_distance", options.inlier_distance, 0.01, 20);
  check("least_inliers", options.least_inliers, 0, 1);
  check("least_constraint", options.least_constraint, 0, 1);
}

PreparedScan::PreparedScan(const PointCloud& cloud, const RegistrationOptions& options) {
  check(options);
  const auto parts = std::make_shared<Parts>();
  parts_ = parts;
  parts->range = options.max_range;
  parts->points = thinned(cloud, options.voxel, options.max_range);
  if (parts->points.size() < kLeastPoints) return;

  parts->tree.emplace(parts->points);
  constexpr size_t kNeighbours = 20;  // of the GICP paper
  std::vector<uint32_t> neighbours;
  std::vector<float> squares;
  for (const Eigen::Vector3f& point : parts->points) {
    parts->tree->nearest(point, kNeighbours, &neighbours, &squares);
    parts->normals.push_back(normal_of(parts->points, neighbours));
    if (is_upright(parts->normals.back())) parts->upright.push_back(point);
  }
}

int64_t PreparedScan::size() const {
  return static_cast<int64_t>(parts_->points.size());
}

const std::vector<Eigen::Vector3f>& PreparedScan::points() const {
  return parts_->points;
}

const std::vector<Eigen::Vector3f>& PreparedScan::normals() const {
  return parts_->normals;
}

}  // namespace revisit::pipeline
