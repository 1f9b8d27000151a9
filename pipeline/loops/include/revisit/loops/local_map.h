#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <unordered_map>
#include <vector>

#include "revisit/recognition/points.h"

namespace revisit::pipeline {

/// Accumulated points of the last metres of a drive: of the scan and some 20 before it. They cover
/// the surroundings of a sensor with a gap, or with few points.
class LocalMap {
 public:
  /// Throws UsageError unless `metres` is 1 to 200.
  explicit LocalMap(double metres);
  /// Adds the next scan. The points of the last metres in its frame, thinned to the mean of each
  /// voxel; the view holds until the next call.
  PointsView add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor);

 private:
  struct Scan {
    std::vector<Eigen::Vector3i> points;  // thinned; fixed point from `origin_`, so that sums
                                          // that lose a scan are exact
    double along = 0;                     // the drive [m]
  };
  struct Voxel {
    Eigen::Matrix<int64_t, 3, 1> sum = Eigen::Matrix<int64_t, 3, 1>::Zero();
    int64_t points = 0;
  };
  void remove(const std::vector<Eigen::Vector3i>& points);

  double metres_, along_ = 0;
  std::optional<Eigen::Isometry3d> last_;  // pose of the last one that was kept
  std::deque<Scan> scans_;
  Eigen::Vector3d origin_;                      // in the world; where the oldest kept one began
  std::unordered_map<uint64_t, Voxel> voxels_;  // of `scans_`
  PointCloud cloud_;
};

}  // namespace revisit::pipeline
