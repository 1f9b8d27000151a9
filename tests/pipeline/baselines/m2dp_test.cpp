#include <Eigen/Dense>

#include "point_features.h"
#include "revisit/baselines/baselines.h"
#include "testing.h"

namespace revisit {
namespace {

/// An asymmetric blob with distinct principal axes and tails.
PointCloud blob(unsigned seed, int n = 500) {
  std::mt19937 random(seed);
  std::exponential_distribution<float> tail(1);
  PointCloud cloud;
  for (int i = 0; i < n; ++i)
    cloud.points.push_back({20 * tail(random), 8 * tail(random), 2 * tail(random), 0});
  return cloud;
}

PointCloud turned(const PointCloud& cloud, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  PointCloud result;
  for (const Point& p : cloud.points) {
    const Eigen::Vector3d q = R * Eigen::Vector3d(p.x, p.y, p.z) + t;
    result.points.push_back(
        {static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()), 0});
  }
  return result;
}

std::vector<float> descriptor_of(const PointCloud& cloud) {
  std::vector<float> descriptor(kM2dpDim);
  m2dp(cloud, descriptor);
  return descriptor;
}

double distance(const std::vector<float>& a, const std::vector<float>& b) {
  double squares = 0;
  for (size_t i = 0; i < a.size(); ++i) squares += std::pow(a[i] - b[i], 2);
  return std::sqrt(squares);
}

/// Reference: counts of one plane with atan2 and square roots, for aligned points.
std::vector<int> slow_counts(const std::vector<Eigen::Vector3d>& points, double radius,
                             double azimuth, double elevation) {
  const Eigen::Vector3d normal(std::cos(elevation) * std::cos(azimuth),
                               std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Eigen::Vector3d u = Eigen::Vector3d::UnitX() - normal.x() * normal, v = normal.cross(u);
  std::vector<int> counts(kM2dpBins);
  for (const Eigen::Vector3d& p : points) {
    const double px = u.dot(p), py = v.dot(p);
    const int circle = std::min(7, static_cast<int>(8 * std::sqrt(std::hypot(px, py) / radius)));
    const int sector = std::min(15, static_cast<int>((std::atan2(py, px) + kPi) / (kPi / 8)));
    ++counts[static_cast<size_t>(circle * 16 + sector)];
  }
  return counts;
}

TEST(M2dp, SignaturesAgreeWithTheSlowTwin) {
  // Reference alignment: Eigen's axes, with the signs of the tails.
  const PointCloud cloud = blob(3);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Point& p : cloud.points) mean += Eigen::Vector3d(p.x, p.y, p.z) / 500;
  Eigen::MatrixXd centered(500, 3);
  for (int i = 0; i < 500; ++i)
    centered.row(i) =
        Eigen::Vector3d(cloud.points[i].x, cloud.points[i].y, cloud.points[i].z) - mean;
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(centered, Eigen::ComputeThinV);
  Eigen::Matrix3d axes = svd.matrixV();
  for (int a = 0; a < 2; ++a)
    if ((centered * axes.col(a)).array().cube().sum() < 0) axes.col(a) *= -1;
  axes.col(2) = axes.col(0).cross(axes.col(1));
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 500; ++i) points.emplace_back(axes.transpose() * centered.row(i).transpose());

  const std::vector<double> signatures = m2dp_signatures(cloud);
  ASSERT_EQ(signatures.size(), 64U * 128U);
  int moved = 0;
  for (int p = 0; p < 4; ++p)
    for (int q = 0; q < 16; ++q) {
      const auto counts = slow_counts(points, centered.rowwise().norm().maxCoeff(),
                                      -kPi / 2 + p * kPi / 3, q * kPi / 30);
      for (int bin = 0; bin < 128; ++bin)
        moved += std::abs(counts[static_cast<size_t>(bin)] -
                          static_cast<int>(std::lround(
                              500 * signatures[static_cast<size_t>((p * 16 + q) * 128 + bin)])));
    }
  // 32,000 points were binned; one within float rounding of a border may fall on its other side,
  // and the plane of azimuth +-90 at elevation 0 looks along y'.
  EXPECT_LE(moved, 4);
}

TEST(M2dp, SectorsAndCirclesByHand) {
  // Points lie on the x' axis, at 8, -4 and -4 after centering (farthest: 8).
  // Top-down (elevation 90 deg: u = x', v = y'), angle 0 is the border of sectors 7 and 8, pi that
  // of 15 and 0. Distance 4 = 8 * 0.5 lies in circle floor(8 sqrt(0.5)) = 5, 8 in the last.
  PointCloud cloud;
  cloud.points = {{12, 1, 1, 0}, {0, 1, 1, 0}, {0, 1, 1, 0}};
  const std::vector<double> signatures = m2dp_signatures(cloud);
  const double* above = signatures.data() + 15 * 128;  // azimuth 0 of 4, elevation 15 of 16
  double ahead = 0, behind = 0, all = 0;
  for (int bin = 0; bin < 128; ++bin) all += above[bin];
  ahead = above[7 * 16 + 7] + above[7 * 16 + 8];
  behind = above[5 * 16 + 0] + above[5 * 16 + 15];
  EXPECT_NEAR(all, 1, 1e-12);
  EXPECT_NEAR(ahead, 1.0 / 3, 1e-12);
  EXPECT_NEAR(behind, 2.0 / 3, 1e-12);
}

TEST(M2dp, DescriptorIsTheFirstPairOfSingularVectors) {
  const PointCloud cloud = blob(5);
  const std::vector<double> values = m2dp_signatures(cloud);
  const Eigen::Map<const Eigen::Matrix<double, 64, 128, Eigen::RowMajor>> a(values.data());
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const std::vector<float> descriptor = descriptor_of(cloud);
  for (int i = 0; i < 64; ++i) EXPECT_NEAR(descriptor[i], std::abs(svd.matrixU()(i, 0)), 1e-6);
  for (int i = 0; i < 128; ++i)
    EXPECT_NEAR(descriptor[64 + i], std::abs(svd.matrixV()(i, 0)), 1e-6);
  double squares = 0;
  for (const float x : descriptor) {
    EXPECT_GE(x, 0);
    squares += x * x;
  }
  EXPECT_NEAR(squares, 2, 1e-5);
}

TEST(M2dp, RotationAndShiftDoNotMatter) {
  const PointCloud cloud = blob(7);
  const std::vector<float> straight = descriptor_of(cloud);
  const double between = distance(straight, descriptor_of(blob(8)));
  for (const double yaw_deg : {3.0, 90.0, 181.0, 300.0}) {
    const Eigen::Matrix3d yaw(Eigen::AngleAxisd(yaw_deg * kPi / 180, Eigen::Vector3d::UnitZ()));
    EXPECT_LT(distance(straight, descriptor_of(turned(cloud, yaw, {5, -3, 1}))), 0.02 * between);
  }
  const Eigen::Matrix3d any(Eigen::AngleAxisd(2, Eigen::Vector3d(1, 2, 3).normalized()));
  EXPECT_LT(distance(straight, descriptor_of(turned(cloud, any, {0, 0, 9}))), 0.02 * between);
}

TEST(M2dp, DegenerateCloudsAreDescribed) {
  PointCloud one;
  one.points = {{1, 2, 3, 0}};
  for (const float x : descriptor_of(one)) EXPECT_TRUE(std::isfinite(x));
  one.points.assign(3, {1, 2, 3, 0});
  for (const float x : descriptor_of(one)) EXPECT_TRUE(std::isfinite(x));
  expect_error<InputError>([] { descriptor_of({}); }, {"no points"});
}

}  // namespace
}  // namespace revisit
