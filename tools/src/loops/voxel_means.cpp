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

std::vector<Eigen::Vector3d> VoxelMeans::points(std::vector<int64_t>* counts) const {
  std::vector<std::pair<uint64_t, const Voxel*>> sorted;
  sorted.reserve(voxels_.size());
  for (const auto& [key, voxel] : voxels_) sorted.emplace_back(key, &voxel);
  std::ranges::sort(sorted, {}, &std::pair<uint64_t, const Voxel*>::first);
  std::vector<Eigen::Vector3d> points;
  points.reserve(sorted.size());
  for (const auto& [key, voxel] : sorted) {
    points.push_back(*origin_ + voxel->first / static_cast<double>(voxel->second));
    if (counts) counts->push_back(voxel->second);
  }
  return points;
}

}  // namespace revisit::cli
