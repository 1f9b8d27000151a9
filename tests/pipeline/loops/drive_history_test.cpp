#include "drive_history.h"

#include <numbers>

#include "testing.h"

namespace revisit {
namespace {

using Motion = Eigen::Translation3d;

/// A hall with walls inside, seen from `x`; `width` of what is seen [m].
SeenScan hall(double x, double width = 40) {
  PointCloud cloud;
  const auto add = [&](double px, double py, double pz) {
    if (std::abs(py) > width / 2) return;
    cloud.points.push_back(
        {static_cast<float>(px - x), static_cast<float>(py), static_cast<float>(pz), 0});
  };
  for (double along = -25; along <= 25; along += 0.25)
    for (double z = -1.5; z <= 3; z += 0.25) {
      for (const double wall : {-24.0, 26.0}) add(wall, along, z);
      for (const double wall : {-18.0, 19.0}) add(along, wall, z);
      add(along, std::floor(along / 6) * 3, z);
      add(along, 10 * z, -1.5);  // floor
    }
  return {cloud, {}};
}

const SeenScan& from_middle() {
  static const SeenScan scan = hall(0);
  return scan;
}

CandidatePlace place_at(int64_t index, double x, const SeenScan& scan = from_middle()) {
  return {index, "monday", Eigen::Isometry3d(Motion(x, 0, 0)), scan};
}

/// Scans at 0, `step`, ... by poses.
DriveHistory driven(int scans, double step) {
  DriveHistory history({.min_inlier_ratio = 0.1}, OdometryGate());
  for (int i = 0; i < scans; ++i) {
    history.arrive(from_middle(), i, Eigen::Isometry3d(Motion(step * i, 0, 0)), {});
    history.add(i, from_middle());
  }
  return history;
}

TEST(DriveHistory, MeasuresTheUsualContradiction) {
  EXPECT_EQ(driven(17, 1).level(0.5), 0.0075) << "too few";
  EXPECT_EQ(driven(30, 0.01).level(1), 0.03) << "a halt";
  EXPECT_EQ(driven(30, 1).level(1), 0.08) << "all points moved: the most";
  DriveHistory registered({.min_inlier_ratio = 0.1}, {});
  for (int i = 0; i < 24; ++i) {
    const SeenScan scan = hall(i % 2);
    registered.arrive(scan, i, {}, 0.0);
    registered.add(i, scan);
  }
  EXPECT_EQ(registered.reference(), 23);
  EXPECT_LT(registered.level(1), 0.02);
}

TEST(DriveHistory, FindsHiddenScans) {
  const SeenScan few = hall(0, 6);
  EXPECT_FALSE(DriveHistory({}, {}).is_hidden(few, few)) << "nothing is usual yet";
  const DriveHistory history = driven(3, 1);
  EXPECT_FALSE(history.is_hidden(from_middle(), from_middle()));
  EXPECT_TRUE(history.is_hidden(few, from_middle()));
  EXPECT_TRUE(history.is_hidden(from_middle(), few));
}

TEST(DriveHistory, PosesRefuteLoops) {
  const DriveHistory history = driven(101, 1);  // at 100 m
  const auto is_refuted = [&](int64_t index, double x, double y, double z) {
    return history.is_refuted(place_at(index, 100), Eigen::Isometry3d(Motion(x, y, z)));
  };
  EXPECT_FALSE(is_refuted(0, 11, 4, 0.9));
  EXPECT_TRUE(is_refuted(0, 12.1, 0, 0)) << "2 m and 10 % of 100 m";
  EXPECT_TRUE(is_refuted(0, 0, 0, 1.1)) << "0.5 m and 0.5 %";
  EXPECT_TRUE(is_refuted(80, 0, 4.1, 0));
  EXPECT_FALSE(is_refuted(999, 50, 0, 0)) << "of another session";
  EXPECT_TRUE(history.is_out_of_reach(0, true, 87.9)) << "100 m away, 2 m and 10 % of 100 m";
  EXPECT_FALSE(history.is_out_of_reach(0, true, 88.1));
}

Eigen::Isometry3d pitched(double degrees) {
  return Eigen::Isometry3d(
      Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Eigen::Vector3d::UnitY()));
}

TEST(DriveHistory, PosesTellARampFromALevelFloor) {
  DriveHistory history = driven(101, 1);
  Eigen::Isometry3d world(Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitX()));
  const auto is_refuted = [&](double by_poses, double by_loop) {
    history.arrive(from_middle(), 101, world * Motion(100, 0, 0) * pitched(by_poses), {});
    CandidatePlace place = place_at(0, 100);
    place.pose = world * *place.pose;
    return history.is_refuted(place, pitched(by_loop));
  };
  EXPECT_TRUE(is_refuted(3.1, 0)) << "2.5 degrees, and 0.005 on each of 100 m";
  EXPECT_TRUE(is_refuted(-3.1, 0));
  EXPECT_FALSE(is_refuted(2.9, 0));
  EXPECT_FALSE(is_refuted(20, 18)) << "the loop shows the tilt";
  EXPECT_TRUE(is_refuted(20, -20));
  EXPECT_FALSE(is_refuted(0, 20)) << "planar poses, or a sensor whose mount is unknown";
  world.linear() *= 0.996;
  EXPECT_FALSE(is_refuted(0, 0)) << "digits of a file: its rotations are not exact";
  const OdometryGate wide{.base = 1e6, .rate = 100, .height = 1e6};
  DriveHistory far({.min_inlier_ratio = 0.1}, wide);
  far.arrive(from_middle(), 0, pitched(0), {});
  far.add(0, from_middle());
  far.arrive(from_middle(), 1, Motion(100, 0, 0) * pitched(179), {});
  EXPECT_FALSE(far.is_refuted(place_at(0, 100), pitched(0))) << "no limit";
}

/// Scans at 0, 1, ... m without poses; rings estimate `relative_yaw` to the scan before.
DriveHistory registered(int scans, double relative_yaw) {
  DriveHistory history({.min_inlier_ratio = 0.1}, OdometryGate());
  for (int i = 0; i < scans; ++i) {
    const SeenScan scan = hall(i);
    history.arrive(scan, i, {}, relative_yaw);
    history.add(i, scan);
  }
  return history;
}

TEST(DriveHistory, RegisteredMotionRefutesLoops) {
  for (const double relative_yaw : {0.0, std::numbers::pi}) {
    SCOPED_TRACE(relative_yaw);  // a hall looks alike when turned around, but nothing turns at once
    const DriveHistory history = registered(9, relative_yaw);  // at 8 m
    const auto is_refuted = [&](double x, double z) {
      CandidatePlace place = place_at(0, 0);
      place.pose.reset();
      return history.is_refuted(place, Eigen::Isometry3d(Motion(x, 0, z)));
    };
    EXPECT_FALSE(is_refuted(8, 0) || is_refuted(4, 0) || is_refuted(12, 1));
    EXPECT_TRUE(is_refuted(3, 0) && is_refuted(13, 0)) << "4 m and 10 % of 8 m";
    EXPECT_TRUE(is_refuted(8, 2)) << "1 m and 10 %";
    EXPECT_TRUE(history.is_out_of_reach(0, false, 3)) << "8 m away";
    EXPECT_FALSE(history.is_out_of_reach(0, false, 3.5));
  }
}

/// A second pass, 1 m to the left of the places at `world`.
struct SecondPass {
  DriveHistory history = driven(101, 1);
  Eigen::Isometry3d world = Eigen::Isometry3d::Identity();
  int64_t first = 0;  // index of the place at 0 m
  std::string drive = "monday";
  Eigen::Isometry3d tilt = Eigen::Isometry3d::Identity();  // of the next loops

  using Frames = std::vector<int64_t>;
  using Result = std::pair<std::string, Frames>;  // objection, questioned
  /// The loop at `x`, off by `error` [m].
  Result loop(int x, double error) {
    history.arrive(from_middle(), 1000 + x, Eigen::Isometry3d(Motion(x, 1, 0)), {});
    const CandidatePlace place{first + x, drive, world * Motion(x, 0, 0), from_middle(), 1.0 * x};
    const Eigen::Isometry3d T = Motion(error, 1, 0) * tilt;
    EXPECT_FALSE(history.is_of_drive(place.index) && history.is_refuted(place, T));
    const std::string objection = history.objection(place, T);
    const Frames questioned = history.take_loop(place, T, objection.empty());
    history.add(1000 + x, from_middle());
    return {objection, questioned};
  }
};

TEST(DriveHistory, LoopsContradictOneAnother) {
  SecondPass pass;
  EXPECT_EQ(pass.loop(0, 4), SecondPass::Result()) << "200 m: the gate lets 22 m pass";
  EXPECT_EQ(pass.loop(1, 0), SecondPass::Result()) << "one against one";
  EXPECT_EQ(pass.loop(2, 0), SecondPass::Result("", SecondPass::Frames{1000}));
  EXPECT_EQ(pass.loop(3, -4), SecondPass::Result("inconsistent", SecondPass::Frames()));
  EXPECT_EQ(pass.loop(4, 0.5), SecondPass::Result());
  EXPECT_EQ(pass.loop(60, -4), SecondPass::Result()) << "more than 30 m on";
}

/// Its places are of another drive, whose poses have another world.
SecondPass on_tuesday() {
  SecondPass pass;
  pass.world = Motion(1000, 50, 3) * Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ());
  pass.first = 500;
  pass.drive = "tuesday";
  return pass;
}

TEST(DriveHistory, TwoLoopsRelateTheWorldsOfTwoDrives) {
  SecondPass pass = on_tuesday();
  EXPECT_EQ(pass.loop(0, 30), SecondPass::Result()) << "nothing relates them";
  EXPECT_EQ(pass.loop(40, 0), SecondPass::Result()) << "a single one does not, it may be incorrect";
  EXPECT_EQ(pass.loop(41, 0.5), SecondPass::Result());
  EXPECT_EQ(pass.loop(81, 11), SecondPass::Result("odometry", SecondPass::Frames()))
      << "2 m and 10 % of 80 m";
  EXPECT_EQ(pass.loop(82, 5), SecondPass::Result());
}

TEST(DriveHistory, TheTiltOfOneLoopDoesNotRelateTwoDrives) {
  SecondPass pass = on_tuesday();
  pass.tilt = pitched(4);
  EXPECT_EQ(pass.loop(40, 0), SecondPass::Result());
  EXPECT_EQ(pass.loop(41, 0), SecondPass::Result());
  pass.tilt.setIdentity();
  EXPECT_EQ(pass.loop(42, 0), SecondPass::Result());
}

TEST(DriveHistory, MoreLoopsThanRelatedTwoDrivesEndTheirRelation) {
  SecondPass pass = on_tuesday();
  for (const int x : {0, 1, 2, 3}) EXPECT_EQ(pass.loop(x, 30), SecondPass::Result());
  const SecondPass::Result refuted("odometry", SecondPass::Frames());
  EXPECT_EQ(pass.loop(60, 0), refuted) << "nothing on 30 m agrees with it";
  for (const int x : {61, 62, 63})
    EXPECT_EQ(pass.loop(x, 0), refuted);  // three loops were accepted
  const SecondPass::Frames all{1000, 1001, 1002, 1003};
  EXPECT_EQ(pass.loop(64, 0), SecondPass::Result("odometry", all));
  EXPECT_EQ(pass.loop(65, 0), SecondPass::Result());
  EXPECT_EQ(pass.loop(66, 30).first, "odometry") << "the others relate the drives now";
}

TEST(DriveHistory, ScatteredLoopsDoNotEndARelation) {
  SecondPass pass = on_tuesday();
  for (const int x : {0, 1, 2, 3}) EXPECT_EQ(pass.loop(x, 0), SecondPass::Result());
  for (const int pair : {0, 1, 2})
    for (const int x : {40, 41})
      EXPECT_EQ(pass.loop(x + 20 * pair, 60 + 40 * pair).second, SecondPass::Frames());
  EXPECT_EQ(pass.loop(120, 0), SecondPass::Result());
}

TEST(OdometryGate, IsParsed) {
  EXPECT_FALSE(parse_odometry_gate("none"));
  const auto gate = parse_odometry_gate("3,0.1,1e9");
  ASSERT_TRUE(gate);
  EXPECT_EQ(std::tuple(gate->base, gate->rate, gate->height), std::tuple(3, 0.1, 1e9));
  for (const char* wrong : {"", "1", "1,2", "1,2,", "1,2,3,", "1,2,3,4", "-1,0,0", "1,x,3", "1,,3"})
    expect_error<UsageError>([&] { parse_odometry_gate(wrong); }, {"BASE,RATE,HEIGHT"});
}

TEST(DriveHistory, AnAcceptedLoopConfirmsOthers) {
  for (const bool by_poses : {true, false}) {
    SCOPED_TRACE(by_poses);
    DriveHistory history = driven(3, 1);
    CandidatePlace first = place_at(10, 0), second = place_at(11, 3, hall(3));
    if (!by_poses) first.pose.reset();  // then by registration of the places
    const auto at = [](double x) { return Eigen::Isometry3d(Motion(x, 0, 0)); };
    EXPECT_FALSE(history.confirms(second, at(0)));
    history.take_loop(first, at(1), true);  // 1 m ahead of the first place
    history.arrive(hall(3), 3, at(4), {});
    EXPECT_TRUE(history.confirms(first, at(3))) << "2 m on";
    EXPECT_TRUE(history.confirms(second, at(0)));
    EXPECT_FALSE(history.confirms(second, at(1.5)));
    for (const auto& axis : {Eigen::Vector3d::UnitZ(), Eigen::Vector3d::UnitY()})
      EXPECT_FALSE(
          history.confirms(second, Eigen::Isometry3d(Eigen::AngleAxisd(0.1, axis.eval()))));
    history.arrive(hall(3), 4, at(13), {});
    EXPECT_FALSE(history.confirms(second, at(9))) << "more than 10 m on";
  }
}

}  // namespace
}  // namespace revisit
