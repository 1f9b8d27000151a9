#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <unordered_map>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Accumulates the points of the last meters of a drive, of about 20 scans. For sensors with a gap
/// in azimuth or with few points.
class LocalMap {
 public:
  explicit LocalMap(double meters) : meters_(meters) {}
  /// Forgets all points, because the motion to the next scan is unknown.
  void clear();
  /// Returns the points of the last meters in the frame of `scan`, averaged per voxel. The view is
  /// valid until the next call.
  PointsView add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor);

 private:
  struct Scan {
    // Averaged per voxel, in fixed point relative to `origin_`: sums stay exact when a scan is
    // subtracted.
    std::vector<Eigen::Vector3i> points;
    double along = 0;  // [m]
  };
  struct Voxel {
    Eigen::Matrix<int64_t, 3, 1> sum = Eigen::Matrix<int64_t, 3, 1>::Zero();
    int64_t points = 0;
  };
  void remove(const std::vector<Eigen::Vector3i>& points);

  double meters_, along_ = 0;
  std::optional<Eigen::Isometry3d> last_;  // pose of the last scan that was kept
  std::deque<Scan> scans_;
  Eigen::Vector3d origin_;  // in the world; start of the oldest scan kept
  std::unordered_map<uint64_t, Voxel> voxels_;
  PointCloud cloud_;
};

}  // namespace revisit
