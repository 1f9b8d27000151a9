#pragma once

#include <array>

#include "sensor_msgs/msg/point_cloud2.hpp"

namespace geometry_msgs::msg {

struct Point {
  double x, y, z;
};

struct Quaternion {
  double x, y, z, w;
};

struct Pose {
  Point position;
  Quaternion orientation;
};

struct PoseWithCovariance {
  Pose pose;
  std::array<double, 36> covariance;
};

struct PoseWithCovarianceStamped {
  std_msgs::msg::Header header;
  PoseWithCovariance pose;
};

}  // namespace geometry_msgs::msg
