#include "revisit/datasets/scan_file.h"
#include "testing.h"

namespace revisit {
namespace {

Eigen::Isometry3d pose(double x, double y, double z, double yaw, double pitch = 0) {
  return Eigen::Translation3d(x, y, z) * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
         Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY());
}

/// Reference: integrates many short straight steps.
TEST(Motion, IsSteady) {
  const Eigen::Isometry3d step = pose(0.0008, 0.0001, -0.0002, 0.0003, -0.0002);
  Eigen::Isometry3d whole = Eigen::Isometry3d::Identity(), third = whole;
  for (int i = 0; i < 3000; ++i) {
    whole = whole * step;
    if (i == 999) third = whole;
  }
  const auto motion = constant_velocity(whole, 0.3);
  EXPECT_TRUE(motion(0.1).isApprox(third, 1e-9));
  EXPECT_TRUE(motion(-0.1).isApprox(third.inverse(), 1e-9));
  const auto straight = constant_velocity(pose(1, 2, 3, 0), 0.5);
  EXPECT_TRUE(straight(0.25).isApprox(pose(0.5, 1, 1.5, 0), 1e-12));
  const auto standing = constant_velocity(Eigen::Isometry3d::Identity(), 0.5);
  EXPECT_TRUE(standing(7).isApprox(Eigen::Isometry3d::Identity(), 1e-12));
}

TEST(Motion, PointsGoToWhereTheyAreSeenAtTheStamp) {
  const Eigen::Isometry3d T_before_now = pose(0.8, 0.05, 0, 0.04);
  const auto motion = constant_velocity(T_before_now, 0.1);
  const Eigen::Vector3d wall(10, -3, 1);
  PointCloud cloud;
  for (const float t : {-0.05F, 0.0F, 0.02F, 0.02F, 0.1F}) {
    const Eigen::Vector3f seen = (motion(static_cast<double>(t)).inverse() * wall).cast<float>();
    cloud.points.push_back({seen.x(), seen.y(), seen.z(), 0.5F});
    cloud.times.push_back(t);
  }
  cloud.points.push_back({0, 0, 0, 0});  // no return
  cloud.times.push_back(0.1F);
  PointCloud untimed = cloud;
  deskew(T_before_now, 0.1, cloud);
  for (size_t i = 0; i < 5; ++i) {
    const Point& p = cloud.points[i];
    EXPECT_LT((Eigen::Vector3d(p.x, p.y, p.z) - wall).norm(), 1e-5) << i;
    EXPECT_EQ(p.intensity, 0.5F);
  }
  EXPECT_FALSE(is_return(cloud.points[5]));
  untimed.times.clear();
  const PointCloud before = untimed;
  deskew(T_before_now, 0.1, untimed);
  EXPECT_EQ(untimed.points[0].x, before.points[0].x);
}

/// Gaps, bunched stamps and odometry jumps disable deskewing.
TEST(Motion, NoPointMovesByAMotionThatCannotGoOn) {
  PointCloud cloud;
  cloud.points.push_back({10, 0, 0, 0});
  cloud.times.push_back(0.1F);
  deskew(pose(30, 0, 0, 0), 3, cloud);
  deskew(pose(0.8, 0, 0, 0), 0.001, cloud);
  deskew(pose(500, 0, 0, 0), 0.1, cloud);
  deskew(pose(0, 0, 0, 3), 0.1, cloud);
  EXPECT_EQ(cloud.points[0].x, 10);
  deskew(pose(0.8, 0, 0, 0), 0.1, cloud);
  EXPECT_NEAR(cloud.points[0].x, 10.8, 1e-5);
}

TEST(Motion, FilesKeepTheTimesOfPoints) {
  const TempDir dir;
  write_file(dir / "a.pcd",
             "FIELDS x y z intensity time\nSIZE 4 4 4 4 4\nTYPE F F F F F\nWIDTH 2\nDATA ascii\n"
             "1 2 3 0.5 0\n4 5 6 0.25 0.0625\n");
  PointCloud read = read_scan(dir / "a.pcd");
  EXPECT_EQ(read.times, (std::vector<float>{0, 0.0625F}));
  EXPECT_EQ(read.points[1].intensity, 0.25F);
  write_kitti_scan(dir / "a.bin", read);
  read_scan_into(dir / "a.bin", read);
  EXPECT_TRUE(read.times.empty()) << "of the scan before";

  const std::vector<float> expected = {0, 0.1F};
  write_file(dir / "b.pcd",
             "FIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nWIDTH 2\nDATA ascii\n"
             "1 2 3 0\n4 5 6 100000000\n");
  EXPECT_EQ(read_scan(dir / "b.pcd").times, expected);
  write_file(dir / "c.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
             "property float z\nproperty double timestamp\nend_header\n"
             "1 2 3 1700000000.5\n4 5 6 1700000000.6\n");
  EXPECT_NEAR(read_scan(dir / "c.ply").times.at(1), 0.1, 1e-6);
  write_file(dir / "d.ply",
             "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
             "property float z\nproperty float s\nproperty float t\nend_header\n"
             "1 2 3 0.5 0.1\n4 5 6 0.5 0.2\n");
  EXPECT_TRUE(read_scan(dir / "d.ply").times.empty()) << "a coordinate in a texture";
  // float32 has steps of 128 s there.
  write_file(dir / "e.pcd",
             "FIELDS x y z t\nSIZE 4 4 4 8\nTYPE F F F F\nWIDTH 2\nDATA ascii\n"
             "1 2 3 1700000000.5\n4 5 6 1700000000.6\n");
  EXPECT_NEAR(read_scan(dir / "e.pcd").times.at(1), 0.1, 1e-6);
}

}  // namespace
}  // namespace revisit
