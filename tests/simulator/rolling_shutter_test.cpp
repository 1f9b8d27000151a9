#include "lidar.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/registration/registration.h"
#include "testing.h"
#include "town.h"

namespace revisit {
namespace {

TEST(RollingShutter, IsUndone) {
  using namespace simulation;
  const TempDir dir;
  const Town town(quick(dir.path()));
  const BeamPattern pattern = beam_pattern("vlp16");
  const Scene scene(town.world.mesh);
  RayCaster rays(scene);
  Lidar lidar(pattern, {.range_sigma = 0, .dropout = 0}, 1);
  const PlanarPose& at = town.streets.poses[100];
  const double ground = town.streets.ground.height({at.x, at.y});
  const Eigen::Isometry3d T_world_now(Eigen::Translation3d(at.x, at.y, ground + 1.7) *
                                      Eigen::AngleAxisd(at.yaw, Eigen::Vector3d::UnitZ()));
  const Eigen::Isometry3d T_before_now(Eigen::Translation3d(1.2, 0, 0) *
                                       Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitZ()));
  const PointCloud still = lidar.scan(1, T_world_now, rays);
  EXPECT_TRUE(still.times.empty());
  PointCloud moving =
      lidar.scan(1, T_world_now, rays, constant_velocity(T_before_now, kFramePeriod));
  ASSERT_EQ(moving.times.size(), moving.points.size());
  EXPECT_LT(*std::ranges::max_element(moving.times), 0.1F);
  const auto error = [&](const PointCloud& cloud) {
    const Registration found = register_scans(PreparedScan(cloud), PreparedScan(still), 0);
    return found.T_place_query.translation().norm();
  };
  EXPECT_GT(error(moving), 0.2);
  deskew(T_before_now, kFramePeriod, moving);
  EXPECT_LT(error(moving), 0.02);
}

}  // namespace
}  // namespace revisit
