#include <cmath>

#include "revisit/datasets/scan_file.h"

namespace revisit {
namespace {

constexpr double kStraight = 1e-9;  // [rad]; smaller rotations are ignored

Eigen::Matrix3d cross_product(const Eigen::Vector3d& v) {
  Eigen::Matrix3d cross;
  cross << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return cross;
}

/// Integrates a unit velocity that rotates with the sensor by `angle`, over a unit of time.
Eigen::Matrix3d arc(const Eigen::Vector3d& axis, double angle) {
  if (std::abs(angle) <= kStraight) return Eigen::Matrix3d::Identity();
  const double along = std::sin(angle) / angle;
  return along * Eigen::Matrix3d::Identity() + (1 - std::cos(angle)) / angle * cross_product(axis) +
         (1 - along) * axis * axis.transpose();
}

/// Rejects gaps, jumps of odometry and invalid stamps.
bool is_steady(const Eigen::Isometry3d& T_before_after, double seconds) {
  constexpr double kMaxGap = 2, kFastest = 60, kFastestTurn = 6.3;  // [s], [m/s], [rad/s]
  return seconds > 0 && seconds <= kMaxGap &&
         T_before_after.translation().norm() <= kFastest * seconds &&
         Eigen::AngleAxisd(T_before_after.rotation()).angle() <= kFastestTurn * seconds;
}

}  // namespace

std::function<Eigen::Isometry3d(double time)> constant_velocity(
    const Eigen::Isometry3d& T_before_after, double seconds) {
  const Eigen::AngleAxisd turn(T_before_after.rotation());
  const double rate = turn.angle() / seconds;  // [rad/s]
  const Eigen::Vector3d velocity =
      arc(turn.axis(), turn.angle()).inverse() * T_before_after.translation() / seconds;
  return [axis = Eigen::Vector3d(turn.axis()), rate, velocity](double time) {
    const double angle = rate * time;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    T.translation() = arc(axis, angle) * velocity * time;
    return T;
  };
}

void deskew(const Eigen::Isometry3d& T_before_after, double seconds, PointCloud& cloud) {
  if (cloud.times.empty() || !is_steady(T_before_after, seconds)) return;
  const auto T_start_then = constant_velocity(T_before_after, seconds);
  float time = 0;
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  for (size_t i = 0; i < cloud.points.size(); ++i) {
    Point& point = cloud.points[i];
    if (!is_return(point)) continue;
    if (cloud.times[i] != time) {
      time = cloud.times[i];
      T = T_start_then(static_cast<double>(time)).cast<float>();
    }
    const Eigen::Vector3f p = T * Eigen::Vector3f(point.x, point.y, point.z);
    point.x = p.x();
    point.y = p.y();
    point.z = p.z();
  }
}

}  // namespace revisit
