#include "voxel_means.h"

#include <algorithm>
#include <cmath>

namespace revisit::cli {

void VoxelMeans::add(const Eigen::Vector3d& point) {
  constexpr int kBits = 21;
  constexpr double kMost = 1 << (kBits - 1);  // voxels to each side of the origin
  if (!point.allFinite()) return;
  if (!origin_) origin_ = point;
  const Eigen::Vector3d from = point - *origin_;
  if (from.cwiseAbs().maxCoeff() >= kMost * voxel_) return;
  uint64_t key = 0;
  for (const double x : from)
    key = key << kBits | static_cast<uint64_t>(std::floor(x / voxel_) + kMost);
  auto& [sum, count] = voxels_.try_emplace(key, Eigen::Vector3d::Zero(), 0).first->second;
  sum += from;
  ++count;
}

std::vector<Eigen::Vector3d> VoxelMeans::points() const {
  std::vector<std::pair<uint64_t, Eigen::Vector3d>> means;
  means.reserve(voxels_.size());
  for (const auto& [key, voxel] : voxels_)
    means.emplace_back(key, *origin_ + voxel.first / static_cast<double>(voxel.second));
  std::ranges::sort(means, {}, &std::pair<uint64_t, Eigen::Vector3d>::first);
  std::vector<Eigen::Vector3d> points;
  points.reserve(means.size());
  for (const auto& [key, point] : means) points.push_back(point);
  return points;
}

}  // namespace revisit::cli
