// Declarations of ROS 2 that examples/ros2 uses, after its API reference, so that the node is
// compiled without ROS.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace rclcpp {

struct Logger {};
Logger get_logger(const char* name);

struct Stamp {};
class Time {
 public:
  explicit Time(const Stamp& stamp);
  explicit Time(int64_t nanoseconds);
  double seconds() const;
  int64_t nanoseconds() const;
  operator Stamp() const;
};

struct SensorDataQoS {};

template <class Message>
struct Publisher {
  using SharedPtr = std::shared_ptr<Publisher>;
  void publish(const Message& message);
};

template <class Message>
struct Subscription {
  using SharedPtr = std::shared_ptr<Subscription>;
};

class Node {
 public:
  explicit Node(const std::string& name);
  virtual ~Node();
  Logger get_logger() const;
  double declare_parameter(const std::string& name, double value);
  std::string declare_parameter(const std::string& name, const char* value);
  template <class Message>
  typename Publisher<Message>::SharedPtr create_publisher(const std::string& topic, int depth);
  template <class Message>
  typename Subscription<Message>::SharedPtr create_subscription(
      const std::string& topic, const SensorDataQoS& quality,
      std::function<void(std::shared_ptr<const Message>)> take);
};

void init(int argc, char** argv);
void spin(const std::shared_ptr<Node>& node);
void shutdown();

}  // namespace rclcpp

#define RCLCPP_WARN(logger, ...) static_cast<void>(logger)
#define RCLCPP_FATAL(logger, ...) static_cast<void>(logger)
