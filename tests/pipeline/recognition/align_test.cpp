#include "revisit/recognition/align.h"

#include <Eigen/Geometry>

#include "revisit/datasets/scan_file.h"
#include "testing.h"
#include "turned_cloud.h"

namespace revisit {
namespace {

constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

Point point_of(const Eigen::Vector3f& v) {
  return {v.x(), v.y(), v.z(), 0};
}

/// Returns points at +-a, +-b, +-c along the rows of `axes`, around `center`: covariance axes^T
/// diag(a^2, b^2, c^2)/3 axes about the mean.
PointCloud cross(const Eigen::Matrix3f& axes, const Eigen::Vector3f& lengths,
                 const Eigen::Vector3f& center = Eigen::Vector3f::Zero()) {
  PointCloud cloud;
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F})
      cloud.points.push_back(point_of(center + sign * lengths[axis] * axes.row(axis).transpose()));
  return cloud;
}

/// Returns orthonormal rows: the first along x, the third as near to z as possible.
Eigen::Matrix3f frame(Eigen::Vector3f x, Eigen::Vector3f z) {
  x.normalize();
  z = (z - z.dot(x) * x).normalized();
  Eigen::Matrix3f R;
  R << x.transpose(), z.cross(x).transpose(), z.transpose();
  return R;
}

bool same_bits(const PointCloud& a, const PointCloud& b) {
  return a.points.size() == b.points.size() &&
         std::equal(a.points.begin(), a.points.end(), b.points.begin(),
                    [](const Point& p, const Point& q) {
                      return p.x == q.x && p.y == q.y && p.z == q.z && p.intensity == q.intensity;
                    });
}

TEST(Align, PrincipalDirectionsOfAHandMadeCloud) {
  const Eigen::Matrix3f axes = frame({0.8F, 0.6F, 0}, {0, 0, 1});
  const Alignment alignment = principal_alignment(cross(axes, {6, 3, 1}, {100, -40, 7}));
  EXPECT_TRUE(alignment.R_aligned_sensor.isApprox(axes, 1e-5F)) << alignment.R_aligned_sensor;
  EXPECT_TRUE(alignment.eigenvalues.isApprox(Eigen::Vector3f(12, 3, 1.0F / 3), 1e-4F));
  EXPECT_NEAR(alignment.eigenvalue_ratio, 4, 1e-3);
  EXPECT_NEAR(alignment.abs_t11, 0.8, 1e-5);
  EXPECT_NEAR(alignment.yaw, std::atan2(0.6, 0.8), 1e-5);
  EXPECT_FALSE(alignment.mirrored_choice);
}

TEST(Align, SignsForEveryYawAndBothCases) {
  for (int degrees = -180; degrees < 180; degrees += 7) {
    const auto yaw = static_cast<float>(degrees * std::numbers::pi / 180);
    const Eigen::Matrix3f axes = frame({std::cos(yaw), std::sin(yaw), 0.05F}, {0.02F, 0.1F, 1});
    const PointCloud cloud = cross(axes, {6, 3, 1});
    const Alignment one = principal_alignment(cloud, AlignCase::kOne);
    const Eigen::Matrix3f& R = one.R_aligned_sensor;
    EXPECT_GE(R(0, 0), 0) << degrees;
    EXPECT_GE(R(1, 1), 0) << degrees;
    EXPECT_GE(R(2, 2), 0) << degrees;
    EXPECT_NEAR(R.determinant(), 1, 1e-5) << degrees;
    EXPECT_TRUE((R * R.transpose()).isIdentity(1e-5F)) << degrees;
    EXPECT_NEAR(std::abs(R.row(0).dot(axes.row(0))), 1, 1e-5) << degrees;

    const Alignment two = principal_alignment(cloud, AlignCase::kTwo);
    EXPECT_EQ(two.R_aligned_sensor.row(0), -R.row(0));
    EXPECT_EQ(two.R_aligned_sensor.row(1), -R.row(1));
    EXPECT_EQ(two.R_aligned_sensor.row(2), R.row(2));
    EXPECT_NEAR(std::abs(std::remainder(two.yaw - one.yaw, 2 * std::numbers::pi)), std::numbers::pi,
                1e-5);
  }
}

TEST(Align, FlagsWhereOnlyAMirrorWouldDo) {
  // t33 and t11 are positive, but then t22 = t33 t11 - t31 t13 is not.
  const Eigen::Matrix3f axes = frame({0.1F, -0.8F, 0.79F}, {0.6F, 0.6F, 0.53F});
  ASSERT_LT(axes(1, 1), 0);
  const Alignment alignment = principal_alignment(cross(axes, {6, 3, 1}));
  EXPECT_TRUE(alignment.mirrored_choice);
  EXPECT_NEAR(alignment.R_aligned_sensor.determinant(), 1, 1e-5);
  EXPECT_TRUE(alignment.R_aligned_sensor.isApprox(axes, 1e-4F));
  EXPECT_TRUE(principal_alignment(cross(axes, {6, 3, 1}), AlignCase::kTwo).mirrored_choice);
}

TEST(Align, ExactZerosAreDecidedByTheNextComponent) {
  Eigen::Matrix3f along_y;  // t11 == 0: x' = +y
  along_y << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  EXPECT_EQ(principal_alignment(cross(along_y, {6, 3, 1})).R_aligned_sensor, along_y);
  Eigen::Matrix3f flat_wall;  // t33 == 0: z' = +y
  flat_wall << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  EXPECT_EQ(principal_alignment(cross(flat_wall, {6, 3, 1})).R_aligned_sensor, flat_wall);
}

TEST(Align, FarFromTheOriginCostsNoAccuracy) {
  // 1 m of structure at 10^5 m: one-pass sums in float, and nearly in double, would lose it.
  const Eigen::Matrix3f axes = Eigen::Matrix3f::Identity();
  const Alignment alignment = principal_alignment(cross(axes, {1, 0.5F, 0.25F}, {1e5F, 1e5F, 0}));
  EXPECT_TRUE(alignment.R_aligned_sensor.isApprox(axes, 1e-6F));
  EXPECT_NEAR(alignment.eigenvalue_ratio, 4, 1e-4);
}

TEST(Align, PointsWithoutReturnDoNotCount) {
  const Eigen::Matrix3f axes = frame({0.8F, 0.6F, 0.1F}, {0, 0, 1});
  PointCloud cloud = cross(axes, {6, 3, 1}, {2, 1, 0});
  const Alignment clean = principal_alignment(cloud);
  cloud.points.insert(cloud.points.begin(), {{0, 0, 0, 1}, {kMissing, 1, 2, 3}, {0, -0.0F, 0, 0}});
  cloud.points.push_back({1, std::numeric_limits<float>::infinity(), 0, 0});
  EXPECT_EQ(principal_alignment(cloud).R_aligned_sensor, clean.R_aligned_sensor);
}

TEST(Align, RefusesCloudsWithoutDirection) {
  EXPECT_THROW(principal_alignment({}), InputError);
  EXPECT_THROW(
      principal_alignment({{{1, 2, 3, 0}, {2, 3, 4, 0}, {0, 0, 0, 0}, {kMissing, 0, 0, 0}}}),
      InputError);
  EXPECT_THROW(principal_alignment({std::vector<Point>(100003, Point{0.1F, 0.7F, 1e-3F, 0})}),
               InputError);
  const Alignment line = principal_alignment({{{1, 0, 0, 0}, {2, 0, 0, 0}, {4, 0, 0, 0}}});
  EXPECT_EQ(line.R_aligned_sensor(0, 0), 1);
  EXPECT_TRUE(std::isinf(line.eigenvalue_ratio));
}

TEST(Rotated, AboutTheOriginAndNothingElse) {
  Eigen::Matrix3f R;
  R << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  const PointCloud cloud = rotated({{{1, 2, 3, 0.5F}, {0, 0, 0, 7}, {kMissing, 1, 1, 0}}}, R);
  EXPECT_EQ(cloud.points[0].x, 2);
  EXPECT_EQ(cloud.points[0].y, -1);
  EXPECT_EQ(cloud.points[0].z, 3);
  EXPECT_EQ(cloud.points[0].intensity, 0.5F);
  EXPECT_FALSE(is_return(cloud.points[1]));
  EXPECT_FALSE(is_return(cloud.points[2]));
}

TEST(Align, HalfTurnedCloudInCaseTwoIsTheCloudInCaseOne) {
  std::mt19937 random(3);
  std::normal_distribution<float> normal;
  for (int round = 0; round < 200; ++round) {
    PointCloud cloud;
    for (int i = 0; i < 50; ++i)
      cloud.points.push_back({20 * normal(random) + normal(random) * 5, 7 * normal(random) + 3,
                              normal(random) - 1, 0});
    const PointCloud turned = turned_by_half(cloud);
    const auto one = principal_alignment(cloud, AlignCase::kOne);
    const auto two = principal_alignment(turned, AlignCase::kTwo);
    ASSERT_TRUE(
        same_bits(rotated(cloud, one.R_aligned_sensor), rotated(turned, two.R_aligned_sensor)))
        << "round " << round;
  }
}

TEST(RealScans, DiagonalCovarianceAfterAlignment) {
  REVISIT_NEED_SHARED(folder, "data/kitti/sequences/00/velodyne");
  for (const char* const name : {"000000.bin", "000052.bin", "004501.bin"}) {
    const PointCloud scan = read_scan(folder / name);
    const Alignment alignment = principal_alignment(scan);
    const PointCloud aligned = rotated(scan, alignment.R_aligned_sensor);
    // Reference: covariance of the aligned cloud by definition, in long double.
    std::array<long double, 3> mean{};
    const auto count = static_cast<long double>(aligned.points.size());
    for (const Point& p : aligned.points) {
      mean[0] += p.x / count;
      mean[1] += p.y / count;
      mean[2] += p.z / count;
    }
    std::array<std::array<long double, 3>, 3> covariance{};
    for (const Point& p : aligned.points) {
      const std::array<long double, 3> d = {p.x - mean[0], p.y - mean[1], p.z - mean[2]};
      for (size_t i = 0; i < 3; ++i)
        for (size_t j = 0; j < 3; ++j) covariance[i][j] += d[i] * d[j] / count;
    }
    for (size_t i = 0; i < 3; ++i)
      for (size_t j = 0; j < 3; ++j)
        EXPECT_NEAR(static_cast<double>(covariance[i][j]),
                    i == j ? double{alignment.eigenvalues[static_cast<int>(i)]} : 0, 1e-3)
            << name << " " << i << j;
    EXPECT_LT(std::abs(alignment.yaw), 0.2) << name;  // along the street
  }
}

}  // namespace
}  // namespace revisit
