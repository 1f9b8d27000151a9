// The ROS 2 node of examples/ros2, and its parts without ROS.
#include <bit>
#include <random>

#include "testing.h"

#define main main_of_node
#include "loop_closure_node.cpp"
#undef main

namespace revisit::ros {
namespace {

constexpr int64_t kSecond = 1'000'000'000, kStart = 1'700'000'000 * kSecond + 123'456'789;

/// The walls of a room around a VLP-16; each seed is another one.
PointCloud room(unsigned seed, double yaw = 0) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> amplitude(0.5, 3), phase(0, 6.3);
  std::array<std::pair<double, double>, 8> waves;
  for (auto& [a, p] : waves) std::tie(a, p) = std::pair(amplitude(random), phase(random));
  PointCloud cloud;
  for (int beam = 0; beam < 16; ++beam)
    for (int column = 0; column < 900; ++column) {
      const double azimuth = column * 0.4 / 57.2957795, elevation = (2 * beam - 15) / 57.2957795;
      double range = 15;
      for (size_t k = 0; k < waves.size(); ++k)
        range += waves[k].first *
                 std::cos(static_cast<double>(k + 1) * (azimuth + yaw) + waves[k].second);
      range = std::max(range, 3.0);
      if (elevation < 0) range = std::min(range, 1.7 / std::tan(-elevation));
      const auto at = [&](double v) { return static_cast<float>(v); };
      cloud.points.push_back({at(range * std::cos(azimuth)), at(range * std::sin(azimuth)),
                              at(range * std::tan(elevation)), 0});
    }
  return cloud;
}

Header header_at(int64_t stamp, const std::string& frame = "lidar") {
  return header_of(stamp, frame);
}

struct Field {
  const char* name;
  uint8_t type;
};

/// Packed points with fields x, y, z of a type, and a field of times.
PointCloud2 message_of(const PointCloud& cloud, int64_t stamp, uint8_t type = kFloat32,
                       Field time = {"", 0}, const std::vector<double>& times = {}) {
  PointCloud2 m;
  m.header = header_at(stamp);
  const auto size = [](uint8_t of) { return of == kFloat64 ? 8U : 4U; };
  for (const char* name : {"x", "y", "z"}) {
    m.fields.push_back({name, m.point_step, type});
    m.point_step += size(type);
  }
  if (time.type) {
    m.fields.push_back({time.name, m.point_step, time.type});
    m.point_step += size(time.type);
  }
  m.height = 1;
  m.width = static_cast<uint32_t>(cloud.points.size());
  const auto put = [&](double value, uint8_t of) {
    const auto append = [&](auto number) {
      const auto* bytes = reinterpret_cast<const uint8_t*>(&number);
      m.data.insert(m.data.end(), bytes, bytes + sizeof number);
    };
    if (of == kFloat64) append(value);
    if (of == kFloat32) append(static_cast<float>(value));
    if (of == kUint32) append(static_cast<uint32_t>(value));
    if (of == kInt32) append(static_cast<int32_t>(value));
  };
  for (size_t i = 0; i < cloud.points.size(); ++i) {
    for (const float value : {cloud.points[i].x, cloud.points[i].y, cloud.points[i].z})
      put(value, type);
    if (time.type) put(times[i], time.type);
  }
  m.row_step = m.width * m.point_step;
  return m;
}

TEST(Ros2Messages, HaveTheirPoints) {
  PointCloud cloud;
  for (int i = 0; i < 6; ++i) {
    const auto x = static_cast<float>(i);
    cloud.points.push_back({x, 10 + x, 20.5F + x});
  }
  struct Case {
    const char* name;
    std::function<void(PointCloud2&)> change;
    const char* error;  // "": the points are read
  };
  for (const uint8_t type : {kFloat32, kFloat64})
    for (const auto& [name, change, error] :
         {Case{"one row", [](PointCloud2&) {}, ""},
          Case{"rows", [](auto& m) { m.height = 2, m.width = 3, m.row_step /= 2; }, ""},
          Case{"without a step", [](auto& m) { m.height = 2, m.width = 3, m.row_step = 0; }, ""},
          Case{"padded rows",
               [](auto& m) {
                 m.height = 2, m.width = 3, m.row_step = m.row_step / 2 + 5;
                 m.data.insert(m.data.begin() + m.row_step - 5, 5, 0);
               },
               ""},
          Case{"big-endian", [](auto& m) { m.is_bigendian = true; }, "little-endian"},
          Case{"no z", [](auto& m) { m.fields.pop_back(); }, "fields x, y, z"},
          Case{"integers", [](auto& m) { m.fields[0].datatype = kInt32; }, "float32 or float64"},
          Case{"beyond the step", [](auto& m) { m.fields[2].offset = 100; }, "fields x, y, z"},
          Case{"a byte less", [](auto& m) { m.data.pop_back(); }, "shorter"},
          Case{"one more row", [](auto& m) { m.height = 2; }, "shorter"}}) {
      PointCloud2 m = message_of(cloud, kStart, type);
      change(m);
      if (*error) {
        expect_error<UsageError>([&] { scan_of(m, kStart); }, {error});
        continue;
      }
      const StampedScan scan = scan_of(m, kStart);
      ASSERT_EQ(scan.cloud.points.size(), 6) << name;
      for (size_t i = 0; i < 6; ++i) EXPECT_EQ(scan.cloud.points[i].z, cloud.points[i].z) << name;
    }
  EXPECT_TRUE(scan_of(message_of({}, kStart), kStart).cloud.points.empty());
}

TEST(Ros2Messages, HaveTheTimesOfTheirPoints) {
  PointCloud cloud;
  for (int i = 0; i < 3; ++i) cloud.points.push_back({1, 2, 3});
  const double start = seconds(kStart);
  const auto times_in = [](StampedScan scan) {
    set_times(scan.times, point_times_of({&scan.times, 1}), scan.cloud);
    return scan.cloud.times;
  };
  for (const auto& [time, values] :
       {std::pair(Field{"t", kUint32}, std::vector<double>{0, 5e7, 1e8}),
        std::pair(Field{"time", kFloat32}, std::vector<double>{0, 0.05, 0.1}),
        std::pair(Field{"timestamp", kFloat64},
                  std::vector<double>{start, start + 0.05, start + 0.1}),
        std::pair(Field{"t", kInt32}, std::vector<double>{-1e8, -5e7, 0})}) {
    const auto times = times_in(scan_of(message_of(cloud, kStart, kFloat32, time, values), kStart));
    ASSERT_EQ(times.size(), 3) << time.name;
    EXPECT_NEAR(times[2] - times[0], 0.1, 1e-6) << time.name;
    EXPECT_NEAR(times[0], time.type == kInt32 ? -0.1 : 0, 1e-6) << time.name;
  }
  PointCloud2 two = message_of(cloud, kStart, kFloat32, {"timestampSec", kUint32}, {7, 7, 8});
  EXPECT_EQ(scan_of(two, kStart).times.field, "") << "without nanoseconds";
  two.fields.push_back({"timestampNsec", 0, kUint32});  // the bytes of x
  const double ns = 7e9 + std::bit_cast<uint32_t>(1.0F);
  EXPECT_EQ(scan_of(two, kStart).times.values[1], ns);
  livox_ros_driver2::msg::CustomMsg livox;
  for (const uint32_t offset : {0U, 50'000'000U, 100'000'000U})
    livox.points.push_back({offset, 4, 5, 6});
  const StampedScan scan = livox_scan_of(livox, kStart);
  EXPECT_NEAR(times_in(scan).at(1), 0.05, 1e-6);
  EXPECT_EQ(scan.cloud.points[2].z, 6);
}

TEST(Ros2Poses, AreInterpolated) {
  PoseTrack track;
  const auto add = [&](double time, double x) {
    track.add(kStart + std::llround(time * 1e9),
              Eigen::Translation3d(x, 0, 0) * Eigen::AngleAxisd(x / 10, Eigen::Vector3d::UnitZ()));
  };
  for (const double time : {0.0, 0.5, 1.0, 3.0}) add(time, time);
  for (const auto& [time, x] :
       {std::pair(0.5, 0.5), std::pair(0.75, 0.75), std::pair(3.0, 3.0), std::pair(-0.1, -1.0),
        std::pair(3.1, -1.0), std::pair(2.0, -1.0)}) {
    const Pose pose = track.at(kStart + std::llround(time * 1e9));
    ASSERT_EQ(pose.has_value(), x >= 0) << time;
    EXPECT_NEAR(pose.value_or(Eigen::Isometry3d::Identity()).translation().x(), std::max(x, 0.0),
                1e-3)
        << time;
  }
  add(12, 12);
  EXPECT_FALSE(track.at(kStart)) << "older than 10 s";
  track.add(5, Eigen::Isometry3d::Identity());
  EXPECT_TRUE(track.at(5)) << "another clock";
}

TEST(Ros2Stamps, AreThoseOfEntries) {
  for (const auto& [frame, time, stamp] :
       {std::tuple(kStart, std::optional(seconds(kStart)), kStart),
        std::tuple(int64_t{17}, std::optional(1.5), 3 * kSecond / 2),
        std::tuple(int64_t{17}, std::optional<double>(), int64_t{0})}) {
    Loop loop;
    loop.frame = frame;
    loop.time = time;
    EXPECT_EQ(stamp_of(loop), stamp);
  }
  Registration r;
  r.T_place_query = Eigen::AngleAxisd(kPi / 2, Eigen::Vector3d::UnitZ());
  r.information = Eigen::Matrix<double, 6, 1>(1, 4, 9, 16, 25, 36).asDiagonal();
  const Eigen::Matrix<double, 6, 1> expected(1 / 4.0, 1, 1 / 9.0, 1 / 25.0, 1 / 16.0, 1 / 36.0);
  EXPECT_TRUE(covariance_of(r).diagonal().isApprox(expected));
}

/// Describes a scan by its first point, and keeps all that it sees.
FeatureExtractor recorder(std::vector<PointCloud>& seen) {
  FeatureExtractor extractor;
  extractor.name = extractor.key = "recorder";
  extractor.dim = 2;
  extractor.make = [&seen]() -> FeatureFunction<PointCloud> {
    return [&seen](const PointCloud& cloud, std::span<float> feature) {
      seen.push_back(cloud);
      feature[0] = cloud.points[0].x;
      feature[1] = cloud.points[0].y;
    };
  };
  return extractor;
}

TEST(Ros2FrontEnd, DeskewsScansOnceTheirPosesAreKnown) {
  std::vector<PointCloud> seen;
  std::vector<FrontEnd::Result> results;
  Map map(recorder(seen), {});
  FrontEnd front_end(map, {.exclusion = parse_exclusion("none"), .verify = false}, 1);
  int64_t known = kStart;
  const auto process = [&] {
    front_end.process(
        [&](int64_t stamp) -> Pose {
          if (stamp > known) return std::nullopt;
          return Eigen::Isometry3d(Eigen::Translation3d(10 * seconds(stamp - kStart), 0, 0));
        },
        [&](const FrontEnd::Result& result) { results.push_back(result); });
  };
  const auto add = [&](int64_t stamp) {
    StampedScan scan{.stamp = stamp, .cloud = {}, .times = {"time", {0, 0.1}, seconds(stamp)}};
    scan.cloud.points = {{5, 1, 0, 0}, {5, 1, 0, 0}};
    front_end.add(scan);
    process();
  };
  add(kStart);
  add(kStart + kSecond / 10);
  EXPECT_EQ(results.size(), 1) << "the second scan waits";
  known += kSecond;
  process();
  ASSERT_EQ(results.size(), 2);
  EXPECT_HAS(front_end.point_times().text, "field time, s");
  EXPECT_EQ(seen[0].points[1].x, 5) << "no motion is known before the first scan";
  EXPECT_NEAR(seen[1].points[0].x, 5, 1e-5);
  EXPECT_NEAR(seen[1].points[1].x, 6, 1e-5) << "1 m farther on after 0.1 s";
  expect_error<UsageError>([&] { add(kStart); }, {"comes after one of", "clock"});
  for (const int tenths : {15, 26, 28}) add(kStart + tenths * kSecond / 10);  // no poses
  ASSERT_EQ(results.size(), 3);
  EXPECT_HAS(results[2].warning, "no pose after 1 s");
  EXPECT_FALSE(results[2].pose);
  EXPECT_EQ(results[2].stamp, kStart + 15 * kSecond / 10);
}

/// A node on rooms 20 m apart along x, one a second.
class Ros2Node : public testing::Test {
 protected:
  Ros2Node() : map_((folder_ / "rooms.map").string()) {
    ros2::parameters = {
        {"map", map_}, {"sensor", std::string("vlp16")}, {"exclusion", std::string("seconds=3")}};
    ros2::tf["base_link<-lidar"] = [](int64_t) {
      return std::make_shared<Eigen::Isometry3d>(Eigen::Translation3d(0.2, 0, 0.5));
    };
    ros2::tf["odom<-lidar"] = [this](int64_t stamp) {
      return stamp > known_ ? nullptr : std::make_shared<Eigen::Isometry3d>(pose_at(stamp));
    };
    ros2::published.clear();
    ros2::log.clear();
    node_ = std::make_unique<LoopClosureNode>();
  }
  ~Ros2Node() override { ros2::tf.clear(); }

  Eigen::Isometry3d pose_at(int64_t stamp) { return rooms_.at(stamp); }
  PointCloud2 scan(unsigned seed, double yaw = 0) {
    const int64_t stamp = kStart + static_cast<int64_t>(rooms_.size()) * kSecond;
    rooms_[stamp] =
        Eigen::Translation3d(20.0 * seed, 0, 0) * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ());
    return message_of(room(seed, yaw), stamp);
  }
  static void publish(const PointCloud2& message) {
    ros2::subscribers["points"](std::make_shared<PointCloud2>(message));
  }
  template <class Message>
  static std::vector<Message> published(const std::string& topic) {
    std::vector<Message> all;
    for (const std::any& one : ros2::published[topic]) all.push_back(std::any_cast<Message>(one));
    return all;
  }
  static Locate::Response locate(const PointCloud2& points) {
    const auto asked = std::make_shared<Locate::Request>();
    const auto answer = std::make_shared<Locate::Response>();
    asked->points = points;
    using Call = std::function<void(Locate::Request::SharedPtr, Locate::Response::SharedPtr)>;
    std::any_cast<Call>(ros2::services.at("~/locate"))(asked, answer);
    return *answer;
  }
  void restart() {
    node_.reset();
    ros2::timers.clear();
    node_ = std::make_unique<LoopClosureNode>();
  }

  TempDir folder_;
  const std::string map_;
  std::map<int64_t, Eigen::Isometry3d> rooms_;
  int64_t known_ = kStart + 1000 * kSecond;
  std::unique_ptr<LoopClosureNode> node_;
};

TEST_F(Ros2Node, PublishesLoopsAndTheGraphAndLocatesScans) {
  for (unsigned seed = 0; seed < 8; ++seed) publish(scan(seed));
  EXPECT_TRUE(published<LoopMessage>("loops").empty());
  const PointCloud2 again = scan(3, 0.5);
  known_ = kStart;
  publish(again);
  EXPECT_TRUE(published<LoopMessage>("loops").empty()) << "its pose is not known yet";
  known_ = kStart + 1000 * kSecond;
  for (const auto& timer : ros2::timers) timer();
  const auto loops = published<LoopMessage>("loops");
  ASSERT_EQ(loops.size(), 1);
  EXPECT_EQ(rclcpp::Time(loops[0].query.stamp).nanoseconds(), kStart + 8 * kSecond);
  EXPECT_EQ(rclcpp::Time(loops[0].place.stamp).nanoseconds(), kStart + 3 * kSecond);
  EXPECT_EQ(loops[0].query.frame_id, "lidar");
  EXPECT_EQ(loops[0].drive, "ros");
  EXPECT_GT(loops[0].probability, 0.9);
  const auto& q = loops[0].pose.pose.orientation;
  EXPECT_NEAR(2 * std::atan2(q.z, q.w), 0.5, 0.02);
  for (size_t i = 0; i < 36; i += 7) EXPECT_GT(loops[0].pose.covariance[i], 0);
  const auto graphs = published<MarkerArray>("pose_graph");
  ASSERT_FALSE(graphs.empty());
  EXPECT_EQ(graphs.back().markers[0].points.size(), 9);
  EXPECT_EQ(graphs.back().markers[1].points.size(), 2);

  restart();  // the map is on the disk
  const Locate::Response here = locate(scan(5, -0.3));
  ASSERT_TRUE(here.found && here.has_pose) << here.message;
  EXPECT_NEAR(here.pose.position.x, 100, 0.3);
  EXPECT_EQ(rclcpp::Time(here.loop.place.stamp).nanoseconds(), kStart + 5 * kSecond);
  const Locate::Response nowhere = locate(scan(77));
  EXPECT_FALSE(nowhere.found);
  EXPECT_NE(nowhere.message, "");
}

TEST_F(Ros2Node, ReportsMessagesThatItCannotUse) {
  publish(scan(1));
  PointCloud2 other = scan(2), invalid = scan(3), late = scan(4);
  other.header.frame_id = "rear";
  invalid.data.clear();
  late.header = header_at(kStart);
  for (const auto& [message, said] : {std::pair(other, "a scan of rear is dropped"),
                                      std::pair(invalid, "shorter"), std::pair(late, "clock")}) {
    ros2::log.clear();
    publish(message);
    ASSERT_EQ(ros2::log.size(), 1) << said;
    EXPECT_HAS(ros2::log[0], said);
  }
  EXPECT_HAS(locate(invalid).message, "shorter");
  ros2::parameters["poses"] = std::string("gps");
  expect_error<UsageError>([] { LoopClosureNode(); }, {"tf, odometry or none, found 'gps'"});
  ros2::parameters["poses"] = std::string("odometry");
  restart();
  ros2::tf["body<-lidar"] = ros2::tf["base_link<-lidar"];
  Odometry odometry;
  odometry.header = header_at(kStart + 9 * kSecond, "world");
  odometry.child_frame_id = "body";
  odometry.pose.pose.position.x = 7;
  ros2::subscribers["odometry"](std::make_shared<Odometry>(odometry));
  publish(message_of(room(1), kStart + 9 * kSecond));
  for (const auto& timer : ros2::timers) timer();
  const MarkerArray graph = published<MarkerArray>("pose_graph").back();
  EXPECT_EQ(graph.markers[0].header.frame_id, "world");
  ASSERT_EQ(graph.markers[0].points.size(), 1);
  EXPECT_NEAR(graph.markers[0].points[0].x, 7.2, 1e-9);
}

TEST_F(Ros2Node, StartsWithoutAMountThatNobodyPublishes) {
  ros2::tf.erase("base_link<-lidar");
  ros2::parameters["map"] = std::string();
  restart();
  publish(scan(1));
  EXPECT_HAS(locate(scan(1)).message, "mount is not known yet");
  ros2::now += 3 * kSecond;
  publish(scan(2));
  ASSERT_FALSE(ros2::log.empty());
  EXPECT_HAS(ros2::log.back(), "TF has no base_link <- lidar");
}

}  // namespace
}  // namespace revisit::ros
