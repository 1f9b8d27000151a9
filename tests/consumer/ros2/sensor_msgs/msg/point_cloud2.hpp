#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "std_msgs/msg/header.hpp"

namespace sensor_msgs::msg {

struct PointField {
  static constexpr uint8_t FLOAT32 = 7;
  std::string name;
  uint32_t offset, count;
  uint8_t datatype;
};

struct PointCloud2 {
  using ConstSharedPtr = std::shared_ptr<const PointCloud2>;
  std_msgs::msg::Header header;
  uint32_t height, width, point_step, row_step;
  std::vector<PointField> fields;
  bool is_bigendian, is_dense;
  std::vector<uint8_t> data;
};

}  // namespace sensor_msgs::msg
