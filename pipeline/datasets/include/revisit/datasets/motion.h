#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "revisit/recognition/point_cloud.h"

// Motion of the sensor while it takes a scan.
namespace revisit::pipeline {

/// Names of the fields that hold the times of points, the first of them that is there. A t beside
/// an s is a coordinate in a texture.
constexpr const char* kPointTimeNames[] = {"t", "time", "timestamp", "offset_time",
                                           "point_time_offset"};

/// Times of points as a recording has them -> seconds from the scan's stamp on. Integers are
/// nanoseconds, floating-point numbers seconds, from 10^14 on nanoseconds. Times from a second on
/// are of a clock: they count from `stamp` when it is of the same clock, else from the earliest.
/// Times of 0 there are of points without a return. None for what cannot be times of one scan: all
/// equal, not finite, or more than a second from the stamp.
std::vector<float> point_times(std::span<const double> values, bool nanoseconds,
                               std::optional<double> stamp = {});

/// A constant velocity and turn: the motion `T_before_after` takes `seconds`, more than 0.
class SteadyMotion {
 public:
  SteadyMotion(const Eigen::Isometry3d& T_before_after, double seconds);
  /// The motion of `seconds`, also of less than 0: T_start_then.
  Eigen::Isometry3d after(double seconds) const;

 private:
  Eigen::Vector3d axis_, velocity_;  // [m/s]
  double rate_;                      // [rad/s]
};

/// Moves the points to where they would have been seen at the scan's stamp, by the cloud's times.
/// The sensor goes on as it came: steadily, `T_before_after` in `seconds`. Nothing moves
/// without times, and where the motion cannot go on: no time or more than 2 s between the scans,
/// faster than 60 m/s or 6.3 rad/s.
void deskew(const Eigen::Isometry3d& T_before_after, double seconds, PointCloud& cloud);

}  // namespace revisit::pipeline
