#include "align/facets.h"
#include "testing.h"

namespace revisit {
namespace {

/// z = slope_x x + slope_y y - height, with objects on it.
PointCloud plane(double slope_x, double slope_y, double height, double share_standing) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> along(-15, 15), share(0, 1);
  PointCloud cloud;
  for (int i = 0; i < 20000; ++i) {
    const double x = along(random), y = along(random);
    const double above = share(random) < share_standing ? 6 * share(random) : 0;
    cloud.points.push_back({static_cast<float>(x), static_cast<float>(y),
                            static_cast<float>(slope_x * x + slope_y * y - height + above), 0});
  }
  return cloud;
}

TEST(Ground, IsThePlaneThatStandsUnderThings) {
  for (const double height : {0.4, 1.73, 2.5})
    for (const double slope : {-0.12, 0.0, 0.2}) {
      const auto ground = find_ground(plane(slope, 0.05, height, 0.5));
      ASSERT_TRUE(ground);
      const Eigen::Vector3d up = Eigen::Vector3d(-slope, -0.05, 1).normalized();
      EXPECT_LT((ground->up - up).norm(), 0.005) << slope;
      EXPECT_NEAR(ground->sensor_height, height * up.z(), 0.02);
    }
}

TEST(Ground, IsNotFoundWhereNothingSaysWhereItIs) {
  EXPECT_FALSE(find_ground({}));
  EXPECT_FALSE(find_ground(plane(0.5, 0, 1.7, 0)));  // 27 degrees
  std::mt19937 random(1);
  std::uniform_real_distribution<float> along(-20, 20);
  PointCloud leaves;
  for (int i = 0; i < 2000; ++i)
    leaves.points.push_back({along(random), along(random), along(random), 0});
  EXPECT_FALSE(find_ground(leaves));
  PointCloud little = plane(0, 0, 1.7, 0);
  little.points.resize(40);
  EXPECT_FALSE(find_ground(little));
}

TEST(Ground, TakesPointsThatRoundToItsBorder) {
  // Nearer than 10 m, but 10 m more is 20 m in float.
  PointCloud cloud = plane(0, 0, 1.73, 0);
  const float nearly = std::nextafter(10.0F, 0.0F);
  for (const auto& [x, y] : {std::pair(0.0F, nearly), std::pair(nearly, 0.0F)})
    cloud.points.insert(cloud.points.end(), 10000, {x, y, -1.73F, 0});
  const auto ground = find_ground(cloud);
  ASSERT_TRUE(ground);
  EXPECT_NEAR(ground->sensor_height, 1.73, 1e-3);
}

/// Scan of 16 beams in a corridor of 2 x 24 x 2.8 m, 1 m above the floor.
PointCloud corridor(const Eigen::Matrix3d& R_level_sensor, double noise = 0.01) {
  const Eigen::Vector3d low(-7, -0.8, -1), high(17, 1.2, 1.8);
  std::mt19937 random(1);
  std::normal_distribution<double> error(0, noise);
  PointCloud cloud;
  for (int beam = 0; beam < 16; ++beam)
    for (int column = 0; column < 900; ++column) {
      const double elevation = (2 * beam - 15) * std::numbers::pi / 180;
      const double azimuth = column * std::numbers::pi / 450;
      const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const Eigen::Vector3d d = R_level_sensor * ray;
      const double range =
          (d.array() > 0).select(high.array() / d.array(), low.array() / d.array()).minCoeff();
      const Eigen::Vector3f p = ((range + error(random)) * ray).cast<float>();
      cloud.points.push_back({p.x(), p.y(), p.z(), 0});
    }
  return cloud;
}

TEST(Ground, IsUprightByWallsInBuildings) {
  for (const double degrees : {0.0, 4.0, 10.0, 20.0, 27.0})
    for (const double azimuth : {0.0, 0.7, 1.6, 3.9}) {
      const Eigen::Matrix3d R =
          Eigen::AngleAxisd(degrees * std::numbers::pi / 180,
                            Eigen::Vector3d(std::cos(azimuth), std::sin(azimuth), 0))
              .toRotationMatrix();
      const PointCloud cloud = corridor(R);
      const auto upright = find_upright(cloud, 1.73);
      ASSERT_TRUE(upright) << degrees << " " << azimuth;
      EXPECT_LT((upright->up - R.row(2).transpose()).norm(), 0.01) << degrees << " " << azimuth;
      EXPECT_NEAR(upright->sensor_height, 1, 0.05) << degrees << " " << azimuth;
      if (degrees == 0) continue;
      double lowest = 0, highest = 0;  // floor and ceiling become horizontal
      for (const Point& p : level(cloud, 1.73, azimuth < 1).points) {  // with or without its ground
        lowest = std::min(lowest, double{p.z});
        highest = std::max(highest, double{p.z});
      }
      EXPECT_NEAR(lowest, -1.73, 0.2) << degrees << " " << azimuth;
      EXPECT_NEAR(highest, 1.07, 0.2) << degrees << " " << azimuth;
    }
}

TEST(Ground, WallsMustAgreeAndAreIgnoredOnAWideGround) {
  EXPECT_FALSE(find_upright({}, 1.73));
  EXPECT_FALSE(find_upright(corridor(Eigen::Matrix3d::Identity(), 0.5), 1.73)) << "rough";
  std::mt19937 random(1);
  std::normal_distribution<float> side;
  PointCloud rocks;  // patches of any direction
  for (int i = 0; i < 400; ++i) {
    const Eigen::Vector3f middle =
        5 * Eigen::Vector3f(side(random), side(random), side(random)).normalized();
    const Eigen::Vector3f u(side(random), side(random), side(random));
    const Eigen::Vector3f v(side(random), side(random), side(random));
    for (int j = 0; j < 30; ++j) {
      const Eigen::Vector3f p = middle + 0.1F * (side(random) * u + side(random) * v);
      rocks.points.push_back({p.x(), p.y(), p.z(), 0});
    }
  }
  EXPECT_FALSE(find_upright(rocks, 1.73));
  EXPECT_FALSE(find_ground(corridor(Eigen::Matrix3d::Identity())).value_or(Ground{}).is_wide);
  EXPECT_TRUE(find_ground(plane(0.05, 0, 1.73, 0.3)).value_or(Ground{}).is_wide);
}

/// An aligned scan does not depend on tilt and mounting; its yaw is kept.
TEST(Ground, LevelsAScanThatWasTilted) {
  const PointCloud scan = plane(0, 0, 1.73, 0.3);
  const PointCloud level_scan = level(scan, 1.73);
  EXPECT_EQ(level_scan.points[5].z, scan.points[5].z);
  const PointCloud nearly = plane(0.02, 0, 1.9, 0.3);  // 1.1 degrees and 0.17 m are not corrected
  EXPECT_EQ(level(nearly, 1.73).points[5].z, nearly.points[5].z);
  for (const double degrees : {-6.0, 4.0, 8.0}) {
    const Eigen::Isometry3f T(
        Eigen::Translation3f(0, 0, 0.7F) *
        Eigen::AngleAxisf(static_cast<float>(degrees * std::numbers::pi / 180),
                          Eigen::Vector3f(0.6F, 0.8F, 0)));
    PointCloud tilted = scan;
    for (Point& p : tilted.points) {
      const Eigen::Vector3f q = T * Eigen::Vector3f(p.x, p.y, p.z);
      p = {q.x(), q.y(), q.z(), p.intensity};
    }
    const PointCloud again = level(tilted, 1.73);
    ASSERT_EQ(again.points.size(), level_scan.points.size());
    double square = 0;
    for (size_t i = 0; i < again.points.size(); ++i) {
      const Point &a = again.points[i], &b = level_scan.points[i];
      square += (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z);
    }
    // Points are up to 21 m away: half a degree there is 0.18 m.
    EXPECT_LT(std::sqrt(square / static_cast<double>(again.points.size())), 0.1) << degrees;
  }
}

TEST(Ground, PointsWithoutAReturnAreLeftOut) {
  PointCloud cloud = plane(0, 0, 1.7, 0);
  const size_t returns = cloud.points.size();
  cloud.points.push_back({});
  cloud.points.push_back({NAN, 0, 0, 0});
  EXPECT_EQ(level(cloud, 1.73).points.size(), returns);
}

}  // namespace
}  // namespace revisit
