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
  EXPECT_FALSE(is_refuted(0, 6, 3, 1.4));
  EXPECT_TRUE(is_refuted(0, 7.1, 0, 0)) << "2 m and 5 % of 100 m";
  EXPECT_TRUE(is_refuted(0, 0, 0, 1.6)) << "0.5 m and 1 %";
  EXPECT_TRUE(is_refuted(80, 0, 3.1, 0));
  EXPECT_FALSE(is_refuted(999, 50, 0, 0)) << "of another session";
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
  }
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
    EXPECT_FALSE(history.confirms(
        second, Eigen::Isometry3d(Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitZ()))));
    history.arrive(hall(3), 4, at(13), {});
    EXPECT_FALSE(history.confirms(second, at(9))) << "more than 10 m on";
  }
}

}  // namespace
}  // namespace revisit
