#include "align/ground.h"

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
