#include "revisit/registration/free_space.h"

#include "prepared_scan.h"
#include "testing.h"

namespace revisit {
namespace {

using test::kDegree;

/// Upright square of 0.1 m between points, across x at `x`, `half` wide and high [m].
void add_wall(PointCloud& cloud, float x, float half, float y = 0) {
  for (float u = -half; u <= half; u += 0.1F)
    for (float z = -half; z <= half; z += 0.1F) cloud.points.push_back({x, y + u, z, 0});
}

FreeSpace space_of(const PointCloud& cloud) {
  return {cloud, PreparedScan(cloud)};
}

PointCloud wall(float x, float half) {
  PointCloud cloud;
  add_wall(cloud, x, half);
  return cloud;
}

const Eigen::Isometry3d kSame = Eigen::Isometry3d::Identity();

TEST(FreeSpace, ASurfaceBeforeAWallIsContradicted) {
  const FreeSpace far = space_of(wall(18, 6)), near = space_of(wall(10, 2));
  EXPECT_EQ(far.scale(), 1);
  EXPECT_NEAR(near.scale(), 10 / 16.0, 0.01);
  const PreparedScan fine(wall(10, 2), {.voxel_size = 0.4 * near.scale()});
  const auto points = std::ssize(fine.parts().upright);
  const Contradiction before = contradiction(near, far, kSame),
                      behind = contradiction(far, near, kSame);
  EXPECT_EQ(before.confirmed, 0);
  EXPECT_EQ(before.contradicted, points);
  EXPECT_EQ(behind.confirmed + behind.contradicted, 0) << "hidden or out of view";
  EXPECT_EQ(mutual_contradiction(near, far, kSame), before.fraction(10));
  // Near the surface: within the margin. And moved onto it.
  const Contradiction close =
      contradiction(near, far, Eigen::Isometry3d(Eigen::Translation3d(7.4, 0, 0)));
  EXPECT_EQ(close.confirmed + close.contradicted, 0);
  const Contradiction onto =
      contradiction(near, far, Eigen::Isometry3d(Eigen::Translation3d(8, 0, 0)));
  EXPECT_EQ(onto.confirmed, points);
  EXPECT_EQ((Contradiction{10, 5}.fraction(10)), 0.4);
}

TEST(FreeSpace, ThingsThatMovedAreRemoved) {
  PointCloud busy = wall(18, 6);
  const size_t standing = busy.points.size();
  add_wall(busy, 10, 1);
  const FreeSpace scan = space_of(busy), empty = space_of(wall(18, 6));
  const auto kept = [&](const std::vector<PlacedSpace>& others) {
    return standing_points(busy, scan, others).points.size();
  };
  EXPECT_EQ(kept({}), busy.points.size());
  EXPECT_EQ(kept({{empty, kSame}}), busy.points.size()) << "one may be an error of the poses";
  std::vector<PlacedSpace> others(2, {empty, kSame});
  EXPECT_EQ(kept(others), standing);
  others.resize(8, {scan, kSame});
  EXPECT_EQ(kept(others), standing) << "confirmed by cars that followed";
  others.resize(9, {scan, kSame});
  EXPECT_EQ(kept(others), busy.points.size());
}

TEST(FreeSpace, FewPointsSayNothing) {
  PointCloud few;
  few.points.push_back({1, 2, 3, 0});
  for (const FreeSpace& scan : {space_of(few), space_of({})})
    EXPECT_EQ(mutual_contradiction(scan, space_of(wall(18, 6)), kSame), 0.5);
}

/// The definition, point by point. `scale`: of the pair.
Contradiction twin(const PreparedScan& scan, const PreparedScan& other, double scale_of_other,
                   double scale, const Eigen::Isometry3d& T) {
  const auto azimuth = [](const Eigen::Vector3d& p) { return std::atan2(p.y(), p.x()) / kDegree; };
  const auto elevation = [](const Eigen::Vector3d& p) {
    return std::atan2(p.z(), p.head<2>().norm()) / kDegree;
  };
  const auto covers = [&](const Eigen::Vector3d& surface, const Eigen::Vector3d& p) {
    const double r = surface.norm();
    const double half =
        std::min(6.0, std::asin(std::min(1.0, 0.25 * scale_of_other / r)) / kDegree);
    const double wide = std::min(10.0, half / std::max(0.3, surface.head<2>().norm() / r));
    const double row = std::floor(elevation(p)), column = std::floor(azimuth(p));
    const bool same_row = row == std::floor(elevation(surface));
    const bool same_column = column == std::floor(azimuth(surface));
    const double across = std::remainder(column + 0.5 - azimuth(surface), 360);
    return r >= 0.5 && std::abs(row + 0.5) < 60 &&
           (same_row || std::abs(row + 0.5 - elevation(surface)) <= half) &&
           (same_column || std::abs(across) <= wide);
  };
  const double t = std::clamp((scale - 0.6) / 0.4, 0.0, 1.0);
  Contradiction found;
  for (const Eigen::Vector3f& point : scan.parts().upright) {
    const Eigen::Vector3d p = T * point.cast<double>();
    double nearest = 1e9, surface = 1e9;
    for (const Eigen::Vector3f& q : other.points()) {
      nearest = std::min(nearest, (q.cast<double>() - p).norm());
      if (covers(q.cast<double>(), p)) surface = std::min(surface, q.cast<double>().norm());
    }
    const double margin = (0.3 + 0.2 * t) * scale + (0.01 + 0.01 * t) * p.norm();
    if (nearest < 0.3 * scale)
      ++found.confirmed;
    else if (surface < 1e9 && p.norm() < surface - margin)
      ++found.contradicted;
  }
  return found;
}

TEST(FreeSpace, EqualsItsDefinition) {
  for (const float size : {1.F, 0.6F, 0.3F}) {
    PointCloud one, two;
    for (int i = 0; i < 12; ++i) {
      const auto k = static_cast<float>(i);
      add_wall(one, size * (3 * k - 16), size * 2, size * (k * k - 30));
      add_wall(two, size * (3 * k - 15), size * 2, size * (k * k - 28) * (i % 3 == 0 ? 0.6F : 1.F));
    }
    const FreeSpace a = space_of(one), b = space_of(two);
    const PreparedScan fine_a(one, {.voxel_size = 0.4 * a.scale()});
    const PreparedScan fine_b(two, {.voxel_size = 0.4 * b.scale()});
    const Eigen::Isometry3d T = Eigen::Translation3d(0.8 * size, 1.5 * size, 0.1) *
                                Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitZ());
    const Contradiction found = contradiction(a, b, T);
    const Contradiction expected =
        twin(fine_a, fine_b, b.scale(), std::max(a.scale(), b.scale()), T);
    EXPECT_GT(expected.confirmed, 50) << size;
    EXPECT_GT(expected.contradicted, 50) << size;
    EXPECT_EQ(found.confirmed, expected.confirmed) << size;
    EXPECT_NEAR(static_cast<double>(found.contradicted), static_cast<double>(expected.contradicted),
                1);
  }
}

}  // namespace
}  // namespace revisit
