// ROS 2 node that publishes loop closures.
//   ros2 run revisit_ros loop_closure_node --ros-args -r points:=/velodyne_points -p map:=town.map
// Subscribes to sensor_msgs/PointCloud2 on `points`. Publishes
// geometry_msgs/PoseWithCovarianceStamped on `loops`: the pose of the scan with this stamp in the
// frame of the matched scan's sensor, place_ID, where ID is the map entry. Only loops verified by
// registration are published. Publishes std_msgs/Header on `questioned`: the stamp of an earlier
// scan whose loop later ones contradict. Remove that loop from the pose graph.
#include <revisit/loops/loop_detector.h>

#include <geometry_msgs/msg/pose_with_covariance_stamped.hpp>
#include <rclcpp/rclcpp.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <std_msgs/msg/header.hpp>

using namespace revisit;
using sensor_msgs::msg::PointCloud2;
using sensor_msgs::msg::PointField;
using std_msgs::msg::Header;
using Pose = geometry_msgs::msg::PoseWithCovarianceStamped;

namespace {

PointCloud cloud_of(const PointCloud2& message) {
  PointsView row{message.data.data(), message.width, message.point_step};
  int found = 0;
  for (const PointField& field : message.fields) {
    const bool wanted = field.name == "x" || field.name == "y" || field.name == "z";
    if (!wanted || field.datatype != PointField::FLOAT32) continue;
    (field.name == "x" ? row.x : field.name == "y" ? row.y : row.z) = field.offset;
    found |= 1 << (field.name[0] - 'x');
  }
  if (found != 7 || message.is_bigendian)
    throw revisit::UsageError("points: expected little-endian float32 fields x, y and z");
  PointCloud cloud, part;
  const size_t bytes = row.count * row.stride;
  const size_t step = message.height > 1 ? message.row_step : bytes;  // rows may be padded
  if (bytes == 0 || message.height == 0) return cloud;
  if (bytes > step || message.data.size() < bytes ||
      message.data.size() - bytes < (message.height - 1) * step)
    throw revisit::UsageError("points: the message is shorter than its header states");
  for (size_t i = 0; i < message.height; ++i) {
    row.data = message.data.data() + i * step;
    copy_points(row, part);
    cloud.points.insert(cloud.points.end(), part.points.begin(), part.points.end());
  }
  return cloud;
}

class LoopClosureNode : public rclcpp::Node {
 public:
  LoopClosureNode() : Node("loop_closure") {
    const auto log = [this](const std::string& what) {
      RCLCPP_WARN(get_logger(), "%s", what.c_str());
    };
    const double exclusion = declare_parameter("exclusion_seconds", 30.0);
    map_.emplace(declare_parameter("map", ""),
                 MapOptions{.sensor = declare_parameter("sensor", "")}, log);
    detector_.emplace(
        *map_, LoopDetectorOptions{.drive = declare_parameter("drive", "ros"),
                                   .exclusion = {Exclusion::Kind::kSeconds, exclusion},
                                   .target_precision = declare_parameter("target_precision", 0.99),
                                   .warn = log});
    loops_ = create_publisher<Pose>("loops", 10);
    questioned_ = create_publisher<Header>("questioned", 10);
    points_ = create_subscription<PointCloud2>("points", rclcpp::SensorDataQoS(),
                                               [this](PointCloud2::ConstSharedPtr m) { take(*m); });
  }

 private:
  void take(const PointCloud2& message) {
    Detection found;
    try {
      const rclcpp::Time time(message.header.stamp);
      found = detector_->take(view_of(cloud_of(message)),
                              {.frame = time.nanoseconds(), .time = time.seconds()});
    } catch (const revisit::UsageError& error) {  // the next message may be valid
      found.error = error.what();
    }
    if (!found.error.empty()) RCLCPP_WARN(get_logger(), "%s", found.error.c_str());
    if (found.accepted) publish(message, *found.loop, *found.registered);
    for (const int64_t stamp : found.questioned) {
      Header out;
      out.stamp = rclcpp::Time(stamp);
      questioned_->publish(out);
    }
  }

  void publish(const PointCloud2& message, const Loop& loop, const Registration& r) {
    Pose out;
    out.header.stamp = message.header.stamp;
    out.header.frame_id = "place_" + std::to_string(loop.id);
    const Eigen::Vector3d t = r.T_place_query.translation();
    const Eigen::Quaterniond q(r.T_place_query.rotation());
    out.pose.pose.position.x = t.x();
    out.pose.pose.position.y = t.y();
    out.pose.pose.position.z = t.z();
    out.pose.pose.orientation.x = q.x();
    out.pose.pose.orientation.y = q.y();
    out.pose.pose.orientation.z = q.z();
    out.pose.pose.orientation.w = q.w();
    // Covariance of (t, rotation vector), rotated from the scan's to the place's axes, the
    // convention of ROS.
    Eigen::Matrix<double, 6, 6> rotation = Eigen::Matrix<double, 6, 6>::Zero();
    rotation.topLeftCorner<3, 3>() = rotation.bottomRightCorner<3, 3>() =
        r.T_place_query.rotation();
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(out.pose.covariance.data()) =
        rotation * r.information.inverse() * rotation.transpose();
    loops_->publish(out);
  }

  std::optional<Map> map_;
  std::optional<LoopDetector> detector_;
  rclcpp::Publisher<Pose>::SharedPtr loops_;
  rclcpp::Publisher<Header>::SharedPtr questioned_;
  rclcpp::Subscription<PointCloud2>::SharedPtr points_;
};

}  // namespace

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  int code = 0;
  try {
    rclcpp::spin(std::make_shared<LoopClosureNode>());
  } catch (const std::exception& error) {
    RCLCPP_FATAL(rclcpp::get_logger("loop_closure"), "%s", error.what());
    code = 1;
  }
  rclcpp::shutdown();
  return code;
}
