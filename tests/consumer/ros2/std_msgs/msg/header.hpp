#pragma once

#include <string>

#include "rclcpp/rclcpp.hpp"

namespace std_msgs::msg {

struct Header {
  rclcpp::Stamp stamp;
  std::string frame_id;
};

}  // namespace std_msgs::msg
