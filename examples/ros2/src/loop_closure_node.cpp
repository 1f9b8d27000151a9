// ROS 2 node that finds loop closures and places of a map; docs/ROS.md has topics and parameters.
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>

#include <nav_msgs/msg/odometry.hpp>
#include <rclcpp/rclcpp.hpp>
#include <revisit_ros/msg/loop.hpp>
#include <revisit_ros/srv/locate.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>
#include <std_msgs/msg/header.hpp>
#include <visualization_msgs/msg/marker_array.hpp>
#ifdef REVISIT_HAVE_LIVOX
#include <livox_ros_driver2/msg/custom_msg.hpp>
#endif

#include "front_end.h"

using namespace revisit;
using namespace revisit::ros;
using nav_msgs::msg::Odometry;
using sensor_msgs::msg::PointCloud2;
using std_msgs::msg::Header;
using visualization_msgs::msg::Marker;
using visualization_msgs::msg::MarkerArray;
using LoopMessage = revisit_ros::msg::Loop;
using Locate = revisit_ros::srv::Locate;
using Pose = std::optional<Eigen::Isometry3d>;

namespace {

geometry_msgs::msg::Point point_of(const Eigen::Vector3d& t) {
  geometry_msgs::msg::Point point;
  point.x = t.x();
  point.y = t.y();
  point.z = t.z();
  return point;
}

geometry_msgs::msg::Pose message_of(const Eigen::Isometry3d& T) {
  geometry_msgs::msg::Pose pose;
  const Eigen::Quaterniond q(T.rotation());
  pose.position = point_of(T.translation());
  pose.orientation.x = q.x();
  pose.orientation.y = q.y();
  pose.orientation.z = q.z();
  pose.orientation.w = q.w();
  return pose;
}

Eigen::Isometry3d isometry_of(const auto& t, const auto& q) {
  return Eigen::Translation3d(t.x, t.y, t.z) * Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized();
}

Header header_of(int64_t stamp, const std::string& frame) {
  Header header;
  header.stamp = rclcpp::Time(stamp);
  header.frame_id = frame;
  return header;
}

LoopMessage message_of(const Detection& found, int64_t stamp, const std::string& frame) {
  LoopMessage loop;
  loop.query = header_of(stamp, frame);
  loop.place = header_of(stamp_of(*found.loop), frame);
  loop.drive = found.loop->drive;
  loop.entry = found.loop->id;
  loop.pose.pose = message_of(found.registered->T_place_query);
  Eigen::Map<Eigen::Matrix<double, 6, 6>>(loop.pose.covariance.data()) =
      covariance_of(*found.registered);
  loop.probability = found.loop->probability.value_or(0);
  loop.score = found.loop->score;
  return loop;
}

int64_t stamp_in(const auto& message) {
  return rclcpp::Time(message.header.stamp).nanoseconds();
}

class LoopClosureNode : public rclcpp::Node {
 public:
  LoopClosureNode() : Node("loop_closure"), buffer_(get_clock()), listener_(buffer_) {
    const auto text = [this](const char* name, const char* value) {
      return declare_parameter<std::string>(name, value);
    };
    poses_ = text("poses", "tf");
    if (poses_ != "tf" && poses_ != "odometry" && poses_ != "none")
      throw UsageError("parameter poses: expected tf, odometry or none, found '", poses_, "'");
    odometry_frame_ = text("odometry_frame", "odom");
    base_frame_ = text("base_frame", "base_link");
    file_ = text("map", "");
    described_.sensor = text("sensor", "");
    described_.local_map = declare_parameter<double>("local_map", 0);
    options_ = {.drive = text("drive", "ros"),
                .exclusion = parse_exclusion(text("exclusion", "meters=30")),
                .keyframes = text("keyframes", "all"),
                .target_precision = declare_parameter<double>("target_precision", 0.99),
                .warn = [this](const std::string& what) { warn(what); }};
    patience_ = declare_parameter<double>("patience", 1);
    loops_ = create_publisher<LoopMessage>("loops", 10);
    questioned_ = create_publisher<Header>("questioned", 10);
    graph_ = create_publisher<MarkerArray>("pose_graph", 1);
    path_.type = Marker::LINE_STRIP;
    edges_.type = Marker::LINE_LIST;
    edges_.id = 1;
    path_.scale.x = edges_.scale.x = 0.1;
    path_.color.a = edges_.color.a = path_.color.b = edges_.color.g = 1;
    subscribe();
  }
  ~LoopClosureNode() override {
    if (map_ && !file_.empty())
      RCLCPP_INFO(get_logger(), "%s has %s entries", file_.c_str(), str(map_->size()).c_str());
  }

 private:
  void subscribe() {
    using namespace std::chrono_literals;
    kept_.push_back(create_subscription<PointCloud2>(
        "points", rclcpp::SensorDataQoS(), [this](PointCloud2::ConstSharedPtr m) {
          guarded([&] { take(scan_of(*m, stamp_in(*m)), m->header.frame_id); });
        }));
#ifdef REVISIT_HAVE_LIVOX
    using livox_ros_driver2::msg::CustomMsg;
    kept_.push_back(create_subscription<CustomMsg>(
        "livox", rclcpp::SensorDataQoS(), [this](CustomMsg::ConstSharedPtr m) {
          guarded([&] { take(livox_scan_of(*m, stamp_in(*m)), m->header.frame_id); });
        }));
#endif
    if (poses_ == "odometry")
      kept_.push_back(create_subscription<Odometry>(
          "odometry", rclcpp::QoS(50), [this](Odometry::ConstSharedPtr m) {
            odometry_frame_ = m->header.frame_id;
            body_frame_ = m->child_frame_id;
            track_.add(stamp_in(*m), isometry_of(m->pose.pose.position, m->pose.pose.orientation));
          }));
    kept_.push_back(create_service<Locate>(
        "~/locate", [this](Locate::Request::SharedPtr asked, Locate::Response::SharedPtr answer) {
          const std::string error = guarded([&] { locate(asked->points, *answer); });
          if (!error.empty()) answer->message = error;
        }));
    kept_.push_back(create_wall_timer(50ms, [this] { guarded([&] { process(); }); }));
    kept_.push_back(create_wall_timer(1s, [this] { publish_graph(); }));
  }

  void warn(const std::string& what) {
    RCLCPP_WARN(get_logger(), "%s", what.c_str());
  }
  /// Reports invalid messages, because the next one may be valid.
  std::string guarded(const std::function<void()>& work) {
    try {
      work();
      return "";
    } catch (const UsageError& error) {
      warn(error.what());
      return error.what();
    }
  }

  Pose transform(const std::string& to, const std::string& from, int64_t stamp = 0) {
    if (to == from) return Eigen::Isometry3d::Identity();
    try {  // 0: the newest
      const tf2::TimePoint time{std::chrono::nanoseconds(stamp)};
      const auto T = buffer_.lookupTransform(to, from, time).transform;
      return isometry_of(T.translation, T.rotation);
    } catch (const tf2::TransformException&) {
      return std::nullopt;
    }
  }

  /// Opens the map once the sensor's mount is known, or not published for two seconds.
  bool start(const std::string& frame) {
    constexpr double kPatience = 2;  // [s]
    if (front_end_) return true;
    const Pose mount =
        base_frame_.empty() ? Eigen::Isometry3d::Identity() : transform(base_frame_, frame);
    if (!first_) first_ = now();
    if (!mount && (now() - *first_).seconds() < kPatience) return false;
    if (!mount)
      warn("TF has no " + base_frame_ + " <- " + frame +
           ": the sensor's axes are taken as x forward, y left, z up; set base_frame");
    described_.mount = mount.value_or(Eigen::Isometry3d::Identity());
    frame_ = frame;
    map_.emplace(file_, described_, options_.warn);
    front_end_.emplace(*map_, options_, poses_ == "none" ? std::nullopt : std::optional(patience_));
    return true;
  }

  void take(StampedScan scan, const std::string& frame) {
    if (!start(frame)) return;
    if (frame != frame_)
      throw UsageError("a scan of ", frame, " is dropped, because the first was of ", frame_,
                       "; run a node for each LiDAR");
    front_end_->add(std::move(scan));
    process();
  }

  void process() {
    if (!front_end_) return;
    const auto pose_of = [this](int64_t stamp) -> Pose {
      if (poses_ == "tf") return transform(odometry_frame_, frame_, stamp);
      const Pose T_world_body = track_.at(stamp), T_body_sensor = transform(body_frame_, frame_);
      if (!T_body_sensor || !T_world_body) return std::nullopt;
      return *T_world_body * *T_body_sensor;
    };
    front_end_->process(pose_of, [this](const FrontEnd::Result& result) { publish(result); });
  }

  void publish(const FrontEnd::Result& result) {
    if (!result.warning.empty()) warn(result.warning);
    if (const std::string& text = front_end_->point_times().text; text != times_) {
      times_ = text;
      RCLCPP_INFO(get_logger(), "times of points: %s", text.c_str());
    }
    const Detection& found = result.found;
    const bool is_edge = found.accepted && found.registered;
    if (is_edge) loops_->publish(message_of(found, result.stamp, frame_));
    for (const int64_t stamp : found.questioned) questioned_->publish(header_of(stamp, frame_));
    if (!result.pose) return;
    constexpr double kSpacing = 0.3;  // of drawn poses [m]
    const Eigen::Vector3d here = result.pose->translation();
    if (!is_edge && drawn_ && (here - *drawn_).norm() < kSpacing) return;
    drawn_ = here;
    path_.points.push_back(point_of(here));
    if (!is_edge || found.loop->drive != front_end_->detector().drive() || !found.loop->pose)
      return;
    edges_.points.push_back(path_.points.back());
    edges_.points.push_back(point_of(found.loop->pose->translation()));
  }

  void publish_graph() {
    if (path_.points.empty()) return;
    path_.header = edges_.header = header_of(now().nanoseconds(), odometry_frame_);
    MarkerArray graph;
    graph.markers = {path_, edges_};
    graph_->publish(graph);
  }

  void locate(const PointCloud2& points, Locate::Response& answer) {
    if (!start(points.header.frame_id))
      throw UsageError("locate: the sensor's mount is not known yet");
    const StampedScan scan = scan_of(points, stamp_in(points));
    const Detection found = front_end_->detector().locate(view_of(scan.cloud)).front();
    answer.message = found.error.empty() ? found.rejection : found.error;
    answer.found = found.accepted && found.registered;
    if (!answer.found) return;
    answer.loop = message_of(found, scan.stamp, points.header.frame_id);
    answer.has_pose = found.loop->pose.has_value();
    if (answer.has_pose)
      answer.pose = message_of(*found.loop->pose * found.registered->T_place_query);
  }

  tf2_ros::Buffer buffer_;
  tf2_ros::TransformListener listener_;
  std::string poses_, file_, odometry_frame_, body_frame_, base_frame_, times_,
      frame_;  // of the sensor
  double patience_ = 1;
  MapOptions described_;
  LoopDetectorOptions options_;
  std::optional<Map> map_;
  std::optional<FrontEnd> front_end_;
  PoseTrack track_;
  std::optional<rclcpp::Time> first_;
  std::optional<Eigen::Vector3d> drawn_;
  Marker path_, edges_;
  rclcpp::Publisher<LoopMessage>::SharedPtr loops_;
  rclcpp::Publisher<Header>::SharedPtr questioned_;
  rclcpp::Publisher<MarkerArray>::SharedPtr graph_;
  std::vector<std::shared_ptr<void>> kept_;  // subscriptions, timers, the service
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
