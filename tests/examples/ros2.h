// What examples/ros2 uses of ROS 2, after its API reference: enough to compile and run the node
// without ROS. Every header of ROS stands for this file. A test publishes to `subscribers` and
// reads `published`.
#pragma once

#include <Eigen/Geometry>
#include <any>
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace ros2 {
inline std::map<std::string, std::function<void(std::shared_ptr<const void>)>> subscribers;
inline std::map<std::string, std::vector<std::any>> published;
inline std::map<std::string, std::any> parameters, services;
inline std::vector<std::function<void()>> timers;
inline std::vector<std::string> log;
inline int64_t now = 0;  // [ns]
/// By "to<-from"; absent: not known.
inline std::map<std::string, std::function<std::shared_ptr<Eigen::Isometry3d>(int64_t)>> tf;
}  // namespace ros2

namespace builtin_interfaces::msg {
struct Time {
  int32_t sec = 0;
  uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace rclcpp {

struct Duration {
  double seconds() const { return 1e-9 * static_cast<double>(ns); }
  int64_t ns;
};
class Time {
 public:
  explicit Time(const builtin_interfaces::msg::Time& t) : ns_(t.sec * kSecond + t.nanosec) {}
  explicit Time(int64_t nanoseconds) : ns_(nanoseconds) {}
  int64_t nanoseconds() const { return ns_; }
  Duration operator-(const Time& other) const { return {ns_ - other.ns_}; }
  operator builtin_interfaces::msg::Time() const {
    return {static_cast<int32_t>(ns_ / kSecond), static_cast<uint32_t>(ns_ % kSecond)};
  }

 private:
  static constexpr int64_t kSecond = 1'000'000'000;
  int64_t ns_;
};
struct Logger {};
inline Logger get_logger(const char*) {
  return {};
}
struct Clock {};
struct QoS {
  explicit QoS(size_t) {}
};
struct SensorDataQoS : QoS {
  SensorDataQoS() : QoS(5) {}
};
template <class Message>
struct Publisher {
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const Message& message) { ros2::published[topic].push_back(message); }
  std::string topic;
};

class Node {
 public:
  explicit Node(const std::string&) {}
  virtual ~Node() = default;
  Logger get_logger() const { return {}; }
  std::shared_ptr<Clock> get_clock() { return std::make_shared<Clock>(); }
  Time now() const { return Time(ros2::now); }
  template <class T>
  T declare_parameter(const std::string& name, const T& value) {
    const auto given = ros2::parameters.find(name);
    return given == ros2::parameters.end() ? value : std::any_cast<T>(given->second);
  }
  template <class Message>
  typename Publisher<Message>::SharedPtr create_publisher(const std::string& topic, int) {
    return std::make_shared<Publisher<Message>>(topic);
  }
  template <class Message>
  std::shared_ptr<int> create_subscription(
      const std::string& topic, const QoS&,
      std::function<void(std::shared_ptr<const Message>)> take) {
    ros2::subscribers[topic] = [take](std::shared_ptr<const void> message) {
      take(std::static_pointer_cast<const Message>(message));
    };
    return std::make_shared<int>();
  }
  template <class Service>
  std::shared_ptr<int> create_service(
      const std::string& name, std::function<void(std::shared_ptr<typename Service::Request>,
                                                  std::shared_ptr<typename Service::Response>)>
                                   answer) {
    ros2::services[name] = answer;
    return std::make_shared<int>();
  }
  std::shared_ptr<int> create_wall_timer(std::chrono::milliseconds, std::function<void()> work) {
    ros2::timers.push_back(std::move(work));
    return std::make_shared<int>();
  }
};
inline void init(int, char**) {}
inline void spin(const std::shared_ptr<Node>&) {}
inline void shutdown() {}

}  // namespace rclcpp

inline void log_of_ros2(rclcpp::Logger, const char* format, const char* text, ...) {
  ros2::log.push_back(std::string(format) == "%s" ? text : format);
}
#define RCLCPP_INFO(...) log_of_ros2(__VA_ARGS__)
#define RCLCPP_WARN(...) log_of_ros2(__VA_ARGS__)
#define RCLCPP_FATAL(...) log_of_ros2(__VA_ARGS__)

namespace std_msgs::msg {
struct Header {
  builtin_interfaces::msg::Time stamp;
  std::string frame_id;
};
}  // namespace std_msgs::msg

namespace geometry_msgs::msg {
struct Point {
  double x = 0, y = 0, z = 0;
};
struct Quaternion {
  double x = 0, y = 0, z = 0, w = 1;
};
struct Pose {
  Point position;
  Quaternion orientation;
};
struct PoseWithCovariance {
  Pose pose;
  std::array<double, 36> covariance{};
};
struct Transform {
  Point translation;
  Quaternion rotation;
};
struct TransformStamped {
  Transform transform;
};
}  // namespace geometry_msgs::msg

namespace nav_msgs::msg {
struct Odometry {
  using ConstSharedPtr = std::shared_ptr<const Odometry>;
  std_msgs::msg::Header header;
  std::string child_frame_id;
  geometry_msgs::msg::PoseWithCovariance pose;
};
}  // namespace nav_msgs::msg

namespace sensor_msgs::msg {
struct PointField {
  std::string name;
  uint32_t offset = 0;
  uint8_t datatype = 0;
  uint32_t count = 1;
};
struct PointCloud2 {
  using ConstSharedPtr = std::shared_ptr<const PointCloud2>;
  std_msgs::msg::Header header;
  uint32_t height = 0, width = 0;
  std::vector<PointField> fields;
  bool is_bigendian = false;
  uint32_t point_step = 0, row_step = 0;
  std::vector<uint8_t> data;
};
}  // namespace sensor_msgs::msg

namespace livox_ros_driver2::msg {
struct CustomPoint {
  uint32_t offset_time = 0;
  float x = 0, y = 0, z = 0;
  uint8_t reflectivity = 0, tag = 0, line = 0;
};
struct CustomMsg {
  using ConstSharedPtr = std::shared_ptr<const CustomMsg>;
  std_msgs::msg::Header header;
  uint64_t timebase = 0;
  std::vector<CustomPoint> points;
};
}  // namespace livox_ros_driver2::msg

namespace visualization_msgs::msg {
struct Marker {
  enum : int32_t { LINE_STRIP = 4, LINE_LIST = 5 };
  std_msgs::msg::Header header;
  int32_t id = 0, type = 0;
  struct {
    double x = 0;
  } scale;
  struct {
    float r = 0, g = 0, b = 0, a = 0;
  } color;
  std::vector<geometry_msgs::msg::Point> points;
};
struct MarkerArray {
  std::vector<Marker> markers;
};
}  // namespace visualization_msgs::msg

namespace revisit_ros::msg {  // msg/Loop.msg
struct Loop {
  std_msgs::msg::Header query, place;
  std::string drive;
  int64_t entry = 0;
  geometry_msgs::msg::PoseWithCovariance pose;
  double probability = 0, score = 0;
};
}  // namespace revisit_ros::msg
namespace revisit_ros::srv {  // srv/Locate.srv
struct Locate {
  struct Request {
    using SharedPtr = std::shared_ptr<Request>;
    sensor_msgs::msg::PointCloud2 points;
  };
  struct Response {
    using SharedPtr = std::shared_ptr<Response>;
    bool found = false, has_pose = false;
    std::string message;
    msg::Loop loop;
    geometry_msgs::msg::Pose pose;
  };
};
}  // namespace revisit_ros::srv

namespace tf2 {
using TimePoint = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;
struct TransformException : std::runtime_error {
  using std::runtime_error::runtime_error;
};
}  // namespace tf2
namespace tf2_ros {
struct Buffer {
  explicit Buffer(const std::shared_ptr<rclcpp::Clock>&) {}
  geometry_msgs::msg::TransformStamped lookupTransform(const std::string& to,
                                                       const std::string& from,
                                                       const tf2::TimePoint& time) const {
    const auto known = ros2::tf.find(to + "<-" + from);
    const auto T =
        known == ros2::tf.end() ? nullptr : known->second(time.time_since_epoch().count());
    if (!T) throw tf2::TransformException("no transform");
    const Eigen::Vector3d t = T->translation();
    const Eigen::Quaterniond q(T->rotation());
    return {{{t.x(), t.y(), t.z()}, {q.x(), q.y(), q.z(), q.w()}}};
  }
};
struct TransformListener {
  explicit TransformListener(Buffer&) {}
};
}  // namespace tf2_ros
