#pragma once

#include <Eigen/Geometry>
#include <deque>
#include <optional>

#include "revisit/recognition/points.h"

namespace revisit::pipeline {

/// What was seen on the last metres of a drive, by the scan and some 20 before it. It shows what
/// lies around a sensor with a gap, or with few points.
class LocalMap {
 public:
  /// Throws UsageError unless `metres` is 1 to 200.
  explicit LocalMap(double metres);
  /// Adds the next scan. The points of the last metres in its frame, thinned to the mean of each
  /// voxel; the view holds until the next call.
  PointsView add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor);

 private:
  struct Scan {
    PointCloud cloud;  // thinned
    Eigen::Isometry3d T_world_sensor;
    double along = 0;  // the drive [m]
  };
  double metres_, along_ = 0;
  std::optional<Eigen::Isometry3d> last_;  // pose of the last one that was kept
  std::deque<Scan> scans_;
  PointCloud cloud_, moved_;
};

}  // namespace revisit::pipeline
