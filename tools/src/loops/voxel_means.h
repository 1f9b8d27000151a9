#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <utility>
#include <vector>

namespace revisit::cli {

/// The mean of the points in each voxel of a site.
class VoxelMeans {
 public:
  explicit VoxelMeans(double voxel) : voxel_(voxel) {}  ///< edge [m]
  /// Ignores a point that is not finite, or 2^20 voxels from the first.
  void add(const Eigen::Vector3d& point);
  /// The first point; absent without any.
  const std::optional<Eigen::Vector3d>& origin() const { return origin_; }
  /// By voxels, in an order that does not depend on that of add(), but on the origin.
  /// `counts`: numbers of points in them.
  std::vector<Eigen::Vector3d> points(std::vector<int64_t>* counts = nullptr) const;

 private:
  using Voxel = std::pair<Eigen::Vector3d, int64_t>;  // sum from origin_, number of points

  double voxel_;
  std::optional<Eigen::Vector3d> origin_;
  std::unordered_map<uint64_t, Voxel> voxels_;
};

}  // namespace revisit::cli
