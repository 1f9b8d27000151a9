#include "revisit/recognition/align.h"
#include "revisit/recognition/ring/model.h"
#include "street.h"
#include "testing.h"

namespace revisit {
namespace {

PointCloud moved(PointCloud cloud, const std::string& mount) {
  transform(parse_mount(mount), cloud);
  return cloud;
}

/// Simulates deskewed and downsampled scans in body frames: no beams, tilted, other heights.
std::vector<PointCloud> of_a_robot(const Lidar& lidar) {
  PointCloud cloud = street(lidar, 0.03), some;
  std::mt19937 random(6);
  for (const Point& point : cloud.points)
    if (random() % 10 < 4) some.points.push_back(point);
  return {moved(some, "2,4,30,0,0,0.3"), moved(some, "-3,1,200,0.5,0,1.8")};
}

TEST(ChooseModel, TakesTheModelOfTheSensorOrTheNearest) {
  struct Case {
    const char* name;
    Lidar lidar;
    const char* model;
  };
  for (const auto& [name, lidar, model] :
       {Case{"HDL-64E", {64, 2, -24.8}, "hdl64"}, Case{"VLP-16", {16, 15, -15}, "vlp16"},
        Case{"OS1-64", {64, 22.5, -22.5}, "ouster-os1-64"},
        Case{"HDL-32E", {32, 10.67, -30.67}, "vlp16"},
        Case{"HDL-32E upside down in a levelled frame", {32, 30.67, -10.67}, "ouster-os1-64"},
        Case{"OS0-64", {64, 45, -45}, "ouster-os1-64"}, Case{"RS-LiDAR-16", {16, 15, -15}, "vlp16"},
        Case{"Pandar40P", {40, 15, -25}, "vlp16"},
        Case{"OS2-64", {64, 11.25, -11.25}, "ouster-os1-64"},
        Case{"PandarXT-32", {32, 15, -16}, "vlp16"},
        Case{"Pandar64", {64, 15, -25}, "ouster-os1-64"},
        Case{"OS2-128", {128, 11.25, -11.25}, "ouster-os1-64"},
        Case{"OS0-32", {32, 45, -45}, "ouster-os1-64"},
        Case{"OS0-128", {128, 45, -45}, "ouster-os1-64"},
        Case{"OS1-128", {128, 22.5, -22.5}, "ouster-os1-64"},
        Case{"OS1-64, generation 1", {64, 16.6, -16.6}, "ouster-os1-64"},
        Case{"Mid-360", {200, 52, -7}, "livox-mid360"}}) {
    const bool has_beams = lidar.beams <= 128;
    if (has_beams) {
      EXPECT_EQ(choose_ring_model({street(lidar)}).first, model) << name;
    }
    const auto [sensor, reason] = choose_ring_model(of_a_robot(lidar));
    const bool beams_decide = std::string(name).starts_with("OS2");
    if (!beams_decide) {
      EXPECT_EQ(sensor, model) << name << ": " << reason;
    }
  }
}

TEST(Mount, TurnsAboutXThenYThenZThenShifts) {
  const Eigen::Isometry3d T = parse_mount("90,0,90,1,2,3");
  EXPECT_TRUE((T * Eigen::Vector3d(0, 1, 0)).isApprox(Eigen::Vector3d(1, 2, 4)));
  EXPECT_TRUE((T * Eigen::Vector3d(1, 0, 0)).isApprox(Eigen::Vector3d(1, 3, 3)));
  EXPECT_TRUE(parse_mount("0,0,0,0,0,0").matrix().isIdentity(0));
  for (const char* wrong :
       {"", "1,2,3", "1,2,3,4,5,6,7", "1,2,3,4,5,x", "1,2,3,4,5,6,", "nan,0,0,0,0,0", "1,,3,4,5,6"})
    expect_error<UsageError>([&] { parse_mount(wrong); }, {"roll,pitch,yaw,x,y,z"});
}

TEST(Mount, NamesTheMountOfATiltedView) {
  for (const Lidar& lidar : {Lidar{64, 2, -24.8}, Lidar{16, 15, -15}, Lidar{64, 45, -45}}) {
    const PointCloud scan = street(lidar, 0.02);
    EXPECT_EQ(find_view_defect({scan}), "");
    for (const char* fine : {"3,-4,10,0,0,0.3", "0,0,0,1,0,1.8", "0,0,77,0,0,-1"})
      EXPECT_EQ(find_view_defect({moved(scan, fine)}), "") << fine;
    for (const auto& [mount, part] : {std::pair("180,0,0,0,0,0", "the mount 180,0,0,0,0,0"),
                                      std::pair("0,-90,90,0,0,0", "camera"),
                                      std::pair("-90,0,0,0,0,0", "the mount 90,0,0,0,0,0"),
                                      std::pair("0,0,0,150,90,0", "frame of a map")}) {
      const std::string misfit = find_view_defect({scan, moved(scan, mount)});
      const std::string alone = find_view_defect({moved(scan, mount)});
      EXPECT_HAS(alone, part) << mount;
      if (std::string(part) == "frame of a map") {
        EXPECT_EQ(misfit, alone);
      }
    }
    PointCloud millimeters = scan;
    for (Point& p : millimeters.points) p = {1000 * p.x, 1000 * p.y, 1000 * p.z, 0};
    EXPECT_HAS(find_unit_defect(millimeters), "millimeters");
    EXPECT_EQ(find_unit_defect(scan), "");
  }
  // A corridor's walls and a tunnel's ceiling are not ground.
  for (const double half_width : {1.5, 2.5, 4.0})
    for (const double roof : {2.6, 12.0})
      for (const Lidar& lidar :
           {Lidar{16, 15, -15}, Lidar{64, 22.5, -22.5}, Lidar{64, 11.25, -11.25}})
        EXPECT_EQ(find_view_defect({street(lidar, 0.02, half_width, roof)}), "")
            << half_width << " " << roof << " " << lidar.top;
  EXPECT_EQ(find_view_defect({}), "");
  EXPECT_EQ(find_view_defect({PointCloud{}}), "");
  PointCloud few;
  for (const float y : {0.F, 1.F}) few.points.push_back({20, y, 0, 0});
  EXPECT_EQ(find_view_defect({few}), "") << "a few points do not show where the sensor is";
}

TEST(Mount, MessagesNameTheMountThatHelps) {
  const PointCloud scan = street({16, 15, -15}, 0.02);
  for (const auto& [from, mount] :
       {std::pair("180,0,0,0,0,0", "180,0,0,0,0,0"), std::pair("0,-90,90,0,0,0", "-90,0,-90,0,0,0"),
        std::pair("-90,0,0,0,0,0", "90,0,0,0,0,0")}) {
    const PointCloud turned = moved(scan, from);
    EXPECT_HAS(find_view_defect({turned}), mount) << from;
    EXPECT_EQ(find_view_defect({moved(turned, mount)}), "") << from;
    EXPECT_NEAR(moved(turned, mount).points[0].x, scan.points[0].x, 1e-4) << from;
  }
}

}  // namespace
}  // namespace revisit
