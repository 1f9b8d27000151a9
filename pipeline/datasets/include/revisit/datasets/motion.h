#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Field names of per-point times; the first match counts. A t beside an s is a texture coordinate.
constexpr const char* kPointTimeNames[] = {"t", "time", "timestamp", "offset_time",
                                           "point_time_offset"};

/// Converts per-point times of a recording to seconds from the scan's stamp. Integers are
/// nanoseconds. Floating-point values are seconds, or nanoseconds from 10^14 on. Values of a second
/// or more are absolute: they are relative to `stamp` if it has the same clock, else to the
/// earliest; values of 0 then mark points without a return. Returns nothing for values that cannot
/// be times of one scan: all equal, not finite, or more than a second from the stamp.
std::vector<float> point_times(std::span<const double> values, bool nanoseconds,
                               std::optional<double> stamp = {});

/// Constant linear and angular velocity: the motion `T_before_after` takes `seconds`, more than 0.
class ConstantVelocity {
 public:
  ConstantVelocity(const Eigen::Isometry3d& T_before_after, double seconds);
  /// T_start_then; `seconds` may be negative.
  Eigen::Isometry3d after(double seconds) const;

 private:
  Eigen::Vector3d axis_, velocity_;  // [m/s]
  double rate_;                      // [rad/s]
};

/// Moves points to the sensor frame at the scan's stamp, by the cloud's times and the constant
/// velocity `T_before_after` in `seconds`. Nothing moves without times, or if the motion is
/// implausible: no time or more than 2 s between the scans, faster than 60 m/s or 6.3 rad/s.
void deskew(const Eigen::Isometry3d& T_before_after, double seconds, PointCloud& cloud);

}  // namespace revisit
