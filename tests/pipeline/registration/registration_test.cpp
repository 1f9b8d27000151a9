#include "revisit/registration/registration.h"

#include <algorithm>
#include <cstring>
#include <random>

#include "lidar.h"
#include "prepared_scan.h"
#include "ray_caster.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "testing.h"
#include "town.h"

namespace revisit {
namespace {

using namespace simulation;
using test::kDegree;

double yaw_of(const Eigen::Isometry3d& T) {
  return std::atan2(T(1, 0), T(0, 0));
}

TEST(CoarsePose, FindsShiftAndTurn) {
  std::vector<Eigen::Vector3f> place, query;
  const Eigen::Isometry3d truth = Eigen::Translation3d(-3.5, 2, 0) *
                                  Eigen::AngleAxisd(91.5 * kDegree, Eigen::Vector3d::UnitZ());
  for (int i = 0; i < 400; ++i) {
    place.emplace_back(25 * std::sin(static_cast<float>(i)),
                       18 * std::sin(1.7F * static_cast<float>(i * i)), 0.F);
    query.emplace_back((truth.inverse() * place.back().cast<double>()).cast<float>());
  }
  const Eigen::Isometry3d found = coarse_pose(query, place, 90 * kDegree, 6, 60);
  EXPECT_LT((found.translation() - truth.translation()).norm(), 0.51);
  EXPECT_NEAR(yaw_of(found) / kDegree, 91.5, 1e-6);
}

TEST(NearestNeighbors, AreThoseOfAnExhaustiveSearch) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> meters(-10, 10);
  const auto place = [&] {
    return Eigen::Vector3f(meters(random), meters(random), meters(random));
  };
  std::vector<Eigen::Vector3f> points(2000);
  std::generate(points.begin(), points.end(), place);
  const NearestNeighbors search(points, 1.5F);
  for (const size_t most : {size_t{1}, size_t{2}, size_t{20}})
    for (int query = 0; query < 200; ++query) {
      constexpr float kLimit = 4;  // [m^2]
      const Eigen::Vector3f at = place() * 1.2F;
      std::vector<float> expected;
      for (const Eigen::Vector3f& point : points)
        if ((point - at).squaredNorm() < kLimit) expected.push_back((point - at).squaredNorm());
      std::sort(expected.begin(), expected.end());
      expected.resize(std::min(expected.size(), most));
      std::vector<Neighbor> found(most);
      ASSERT_EQ(search.nearest(at, kLimit, found), expected.size());
      for (size_t i = 0; i < expected.size(); ++i) EXPECT_FLOAT_EQ(found[i].squared, expected[i]);
    }
}

TEST(CompactCloud, KeepsTheMeanOfEachVoxel) {
  PointCloud cloud;
  for (int i = 0; i < 200; ++i)
    for (int k = 0; k < 3; ++k)
      cloud.points.push_back({0.1F + 0.7F * static_cast<float>(i % 50) - 17.5F,
                              0.45F + 0.05F * static_cast<float>(k),
                              0.7F * static_cast<float>(i / 50) + 0.3F, 0});
  cloud.points.push_back({std::nanf(""), 0, 0, 0});
  cloud.points.push_back({61, 0, 0, 0});
  const Eigen::Isometry3d turned(Eigen::AngleAxisd(2, Eigen::Vector3d::UnitX()));
  const std::string bytes = compact_cloud(cloud, turned);
  EXPECT_LT(bytes.size(), 500);
  const auto [back, mount] = expand_cloud(bytes);
  ASSERT_EQ(back.points.size(), 200);
  for (const Point& p : back.points) EXPECT_NEAR(p.y, 0.5, 0.5 / 32 + 1e-4);
  EXPECT_NEAR(back.points[0].x, 0.1 - 17.5, 0.5 / 32 + 1e-4);
  EXPECT_TRUE(mount.isApprox(turned, 1e-12));
  for (const size_t n : {1, 0}) {
    cloud.points.resize(n);
    EXPECT_EQ(expand_cloud(compact_cloud(cloud)).first.points.size(), n);
  }
  for (float i = 0; i < 90'000; ++i)
    cloud.points.push_back({std::fmod(i, 73.0F) - 36, std::fmod(i / 73, 37.0F), i / 3000, 0});
  EXPECT_LT(compact_cloud(cloud).size(), 25'000);
  std::string wrong = bytes, far = bytes;
  const double x_of_mount = 1e308;
  std::memcpy(&far[3 * sizeof(double)], &x_of_mount, sizeof(double));
  for (const std::string& damaged :
       {std::string(), bytes.substr(0, 3), bytes.substr(0, 100), bytes.substr(0, bytes.size() - 1),
        far, wrong.replace(96, 1, "X"), std::string(100, '\xff')})
    expect_error<InputError>([&] { expand_cloud(damaged); }, {"points are corrupt"});
}

TEST(Registration, RefusesOptionsThatCannotBe) {
  expect_error<UsageError>([] { PreparedScan(PointCloud{}, {.voxel_size = 0}); }, {"voxel"});
  const PreparedScan scan{PointCloud{}};
  expect_error<UsageError>([&] { register_scans(scan, scan, 0, {.max_distance = -1}); },
                           {"max_distance"});
  expect_error<UsageError>([&] { register_scans(scan, scan, std::nan("")); },
                           {"finite relative yaw"});
}

double angle_between(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

class Street {
 public:
  Street()
      : town_(config()),
        scene_(Mesh(town_.world.mesh)),
        rays_(scene_),
        pattern_(beam_pattern("hdl64")),
        lidar_(pattern_, {}, 1) {}

  /// Pose of the vehicle after `meters`, shifted to the left and rotated counter-clockwise.
  Eigen::Isometry3d pose(double meters, double left = 0, double turn = 0) const {
    const PathPoint& on_path =
        town_.streets.path.points.at(static_cast<size_t>(meters / kPathStep));
    const Eigen::Vector2d p = on_path.position + left * on_path.left();
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    const double heading = std::atan2(on_path.forward.y(), on_path.forward.x()) + turn;
    const Eigen::Vector3d up = town_.streets.ground.normal(p);
    T.linear() = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), up) *
                 Eigen::AngleAxisd(heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() << p.x(), p.y(), town_.streets.ground.height(p);
    T.translation() += kSensorHeight * up;
    return T;
  }

  PointCloud scan(const Eigen::Isometry3d& T_world_velo) {
    return lidar_.scan(++frame_, T_world_velo, rays_);
  }

 private:
  static SimulationConfig config() {
    SimulationConfig config = quick("unused");
    config.seed = 5;
    return config;
  }

  Town town_;
  Scene scene_;
  RayCaster rays_;
  BeamPattern pattern_;
  Lidar lidar_;
  int frame_ = 0;
};

Street& street() {
  static Street street;
  return street;
}

TEST(Registration, FindsHowScansOfAStreetLie) {
  std::vector<double> meters, degrees;
  int i = 0;
  for (const double at : {60, 150, 240}) {
    const Eigen::Isometry3d T_world_place = street().pose(at);
    const PreparedScan place(street().scan(T_world_place));
    for (const double turn : {0, 90, 180})
      for (const double ahead : {0, 2, 4}) {
        const double error = (++i % 5 - 2) * kDegree;
        const Eigen::Isometry3d T_world_query =
            street().pose(at + ahead, i % 3 - 1, turn * kDegree);
        const Eigen::Isometry3d truth = T_world_place.inverse() * T_world_query;
        const PreparedScan query(street().scan(T_world_query));
        const Registration found = register_scans(query, place, yaw_of(truth) + error);
        EXPECT_TRUE(found.fits) << at << " " << turn << " " << ahead << ": " << found.inlier_ratio
                                << " " << found.constraint;
        meters.push_back((found.T_place_query.translation() - truth.translation()).norm());
        degrees.push_back(angle_between(found.T_place_query, truth) / kDegree);
        EXPECT_LT(meters.back(), 0.3);
        EXPECT_LT(degrees.back(), 1);
      }
  }
  std::sort(meters.begin(), meters.end());
  std::sort(degrees.begin(), degrees.end());
  EXPECT_LT(meters[meters.size() / 2], 0.03);
  EXPECT_LT(degrees[degrees.size() / 2], 0.1);
}

/// Reference: naive generalized ICP, which compares all points and differentiates numerically.
class Twin {
 public:
  Twin(const PreparedScan& query, const PreparedScan& place) : query_(query), place_(place) {}

  Eigen::Isometry3d fitted(Eigen::Isometry3d T) {
    for (int step = 0; step < 20; ++step) {
      pair_points(T);
      Eigen::Matrix<double, 6, 6> hessian = Eigen::Matrix<double, 6, 6>::Zero();
      Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
      for (size_t i = 0; i < query_.points().size(); ++i) {
        if (nearest_[i] < 0) continue;
        Eigen::Matrix<double, 3, 6> jacobian;
        for (int k = 0; k < 6; ++k) {
          constexpr double kSmall = 1e-5;
          const Eigen::Matrix<double, 6, 1> h = kSmall * Eigen::Matrix<double, 6, 1>::Unit(k);
          jacobian.col(k) = (apart(i, moved(T, h)) - apart(i, moved(T, -h))) / (2 * kSmall);
        }
        hessian += jacobian.transpose() * weight(i, T) * jacobian;
        gradient += jacobian.transpose() * weight(i, T) * apart(i, T);
      }
      T = moved(T, -hessian.fullPivLu().solve(gradient));
    }
    return T;
  }

 private:
  static Eigen::Isometry3d moved(const Eigen::Isometry3d& T,
                                 const Eigen::Matrix<double, 6, 1>& step) {
    const Eigen::Vector3d w = step.tail<3>();
    return T * Eigen::Translation3d(step.head<3>()) * Eigen::AngleAxisd(w.norm(), w.normalized());
  }

  void pair_points(const Eigen::Isometry3d& T) {
    nearest_.assign(query_.points().size(), -1);
    for (size_t i = 0; i < nearest_.size(); ++i) {
      const Eigen::Vector3f at = (T * query_.points()[i].cast<double>()).cast<float>();
      float best = 1;  // RegistrationOptions::max_distance, squared
      for (size_t k = 0; k < place_.points().size(); ++k) {
        const float squared = (place_.points()[k] - at).squaredNorm();
        if (squared >= best) continue;
        best = squared;
        nearest_[i] = static_cast<int>(k);
      }
    }
  }

  Eigen::Vector3d apart(size_t i, const Eigen::Isometry3d& T) const {
    return T * query_.points()[i].cast<double>() -
           place_.points()[static_cast<size_t>(nearest_[i])].cast<double>();
  }

  Eigen::Matrix3d weight(size_t i, const Eigen::Isometry3d& T) const {
    const auto covariance = [](const Eigen::Vector3f& normal) -> Eigen::Matrix3d {
      const Eigen::Vector3d n = normal.cast<double>();
      return Eigen::Matrix3d::Identity() - 0.999 * n * n.transpose();
    };
    const Eigen::Matrix3d R = T.linear();
    return (covariance(place_.normals()[static_cast<size_t>(nearest_[i])]) +
            R * covariance(query_.normals()[i]) * R.transpose())
        .inverse();
  }

  const PreparedScan& query_;
  const PreparedScan& place_;
  std::vector<int> nearest_;  // [point of the query]; -1: none
};

TEST(Registration, EqualsThePlainForm) {
  // Few points, because the naive version compares all of them
  const RegistrationOptions options{.voxel_size = 0.8};
  const Eigen::Isometry3d a = street().pose(150);
  const PreparedScan place(street().scan(a), options);
  for (const auto& [ahead, turn] : {std::pair{1, 0}, {3, 180}, {4, 75}}) {
    const Eigen::Isometry3d b = street().pose(150 + ahead, 0.5, turn * kDegree);
    const PreparedScan query(street().scan(b), options);
    const Eigen::Isometry3d truth = a.inverse() * b;
    const Registration found = register_scans(query, place, yaw_of(truth) + kDegree, options);
    Eigen::Isometry3d start = truth;
    start.translation() += Eigen::Vector3d(0.1, -0.1, 0.05);
    const Eigen::Isometry3d expected = Twin(query, place).fitted(start);
    EXPECT_LT((found.T_place_query.translation() - expected.translation()).norm(), 0.01);
    EXPECT_LT(angle_between(found.T_place_query, expected), 0.03 * kDegree);
    EXPECT_LT((expected.translation() - truth.translation()).norm(), 0.1);
    EXPECT_LT(angle_between(expected, truth), 0.2 * kDegree);
  }
}

TEST(Registration, TheWayBackIsTheInverse) {
  const Eigen::Isometry3d a = street().pose(100), b = street().pose(103, 1, 2);
  const PreparedScan scan_a(street().scan(a)), scan_b(street().scan(b));
  const double turn = yaw_of(a.inverse() * b);
  const Registration there = register_scans(scan_b, scan_a, turn);
  const Registration back = register_scans(scan_a, scan_b, -turn);
  const Eigen::Isometry3d both = there.T_place_query * back.T_place_query;
  EXPECT_LT(both.translation().norm(), 0.05);
  EXPECT_LT(angle_between(both, Eigen::Isometry3d::Identity()), 0.2 * kDegree);
}

TEST(Registration, AWrongPlaceIsNotAccepted) {
  const PreparedScan here(street().scan(street().pose(60)));
  for (const double elsewhere : {90, 130, 200, 280})
    for (const double turn : {0, 180}) {
      const PreparedScan there(street().scan(street().pose(elsewhere)));
      const Registration found = register_scans(here, there, turn * kDegree);
      EXPECT_FALSE(found.fits) << elsewhere << " " << turn << ": " << found.inlier_ratio;
    }
}

/// Noise alone; tests/python/test_registration.py tests whole poses.
TEST(Registration, InformationSaysHowMuchNoiseMovesThePose) {
  const Eigen::Isometry3d a = street().pose(60), b = street().pose(61, 0.5, 0.1);
  const Eigen::Isometry3d truth = a.inverse() * b;
  const PreparedScan place(street().scan(a));
  Eigen::Matrix<double, 6, 1> squares = Eigen::Matrix<double, 6, 1>::Zero(), promised = squares;
  constexpr int kRuns = 8;  // frames differ in noise
  for (int run = 0; run < kRuns; ++run) {
    const Registration found = register_scans(PreparedScan(street().scan(b)), place, yaw_of(truth));
    const Eigen::Isometry3d error = found.T_place_query.inverse() * truth;
    const Eigen::AngleAxisd turn(error.linear());
    Eigen::Matrix<double, 6, 1> delta;
    delta << error.translation(), turn.angle() * turn.axis();
    squares += delta.cwiseAbs2() / kRuns;
    promised += found.information.inverse().diagonal() / kRuns;
    EXPECT_TRUE(found.information.isApprox(found.information.transpose()));
  }
  for (int i = 0; i < 6; ++i) {
    const double ratio = std::sqrt(squares[i] / promised[i]);
    EXPECT_GT(ratio, 0.02) << i;  // errors are not zero
    EXPECT_LT(ratio, 2) << i;
  }
}

/// A room around the sensor that is `length` x 8 x 4 m, seen by the HDL-64E.
PointCloud room(double length, int frame) {
  Mesh mesh;
  const auto x = static_cast<float>(length / 2);
  mesh.box({-x, -4, -2}, {x, 4, 2}, surface(Material::kSolid, 0.9));
  mesh.quad({-x, -4, -2}, {x, -4, -2}, {x, 4, -2}, {-x, 4, -2}, surface(Material::kSolid, 0.9));
  const Scene scene(std::move(mesh));
  RayCaster rays(scene);
  const BeamPattern pattern = beam_pattern("hdl64");
  return Lidar(pattern, {}, 1).scan(frame, Eigen::Isometry3d::Identity(), rays);
}

TEST(Registration, ACorridorIsNotHeldAlongItsAxis) {
  const auto along_by_across = [](double length) {
    const Registration found =
        register_scans(PreparedScan(room(length, 1)), PreparedScan(room(length, 2)), 0);
    EXPECT_GT(found.inlier_ratio, 0.8);
    EXPECT_EQ(found.fits, length < 100) << found.constraint;
    return found.information(0, 0) / found.information(1, 1);
  };
  EXPECT_GT(along_by_across(20), 0.5);
  EXPECT_LT(along_by_across(300), 0.8);  // across it cannot be more than (10 mm)^-2
}

TEST(Registration, AScanOfHardlyAnythingIsNotAccepted) {
  const PreparedScan good(room(20, 1));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  PointCloud none, nans, three, ground, wall, line, same;
  nans.points.assign(5000, {nan, 1, 2, 0});
  three.points = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};
  for (int i = 0; i < 100; ++i)
    for (int k = 0; k < 100; ++k) {
      const float u = 0.5F * static_cast<float>(i - 50), v = 0.5F * static_cast<float>(k - 50);
      ground.points.push_back({u, v, -1.7F, 0});
      wall.points.push_back({u, 5, v, 0});
      line.points.push_back({0.01F * (u + 100 * v), 1, 0, 0});
      same.points.push_back({1, 2, 3, 0});
    }
  for (const PointCloud* cloud : {&none, &nans, &three, &ground, &wall, &line, &same}) {
    const PreparedScan scan(*cloud);
    for (const PreparedScan* other : {&good, &scan}) {
      for (const bool swap : {false, true}) {
        const Registration found = register_scans(swap ? *other : scan, swap ? scan : *other, 1);
        EXPECT_FALSE(found.fits) << cloud->points.size() << " " << found.inlier_ratio << " "
                                 << found.constraint;
        EXPECT_TRUE(found.T_place_query.matrix().allFinite());
        EXPECT_TRUE(found.information.allFinite());
      }
    }
  }
}

/// A room hidden by a lorry: about 50 non-ground points, which fit.
TEST(Registration, FewUprightPointsSayLittle) {
  const PointCloud whole = room(20, 1);
  PointCloud few;
  for (const Point& p : whole.points)
    if (p.z < -1.9F || (p.x > 9.5F && std::abs(p.y) < 1)) few.points.push_back(p);
  const PreparedScan place(whole);
  EXPECT_GT(register_scans(PreparedScan(whole), place, 0).inlier_ratio, 0.9);
  const double ratio = register_scans(PreparedScan(few), place, 0).inlier_ratio;
  EXPECT_GT(ratio, 0.05);
  EXPECT_LT(ratio, 0.4);
}

TEST(Registration, PointsThatAreNoReturnsChangeNothing) {
  PointCloud cloud = room(20, 1);
  const PreparedScan plain(cloud);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (size_t i = 0; i < cloud.points.size(); i += 50)
    cloud.points.insert(cloud.points.begin() + static_cast<std::ptrdiff_t>(i),
                        i % 100 == 0 ? Point{nan, 0, 0, 0} : Point{});
  EXPECT_EQ(PreparedScan(cloud).points().size(), plain.points().size());
}

TEST(Registration, ThreadsShareScansAndAgreeBitForBit) {
  const PreparedScan query(room(20, 1)), place(room(20, 2));
  std::vector<Registration> found(4);
  std::vector<std::thread> threads;
  for (Registration& result : found)
    threads.emplace_back([&] { result = register_scans(query, place, 0.02); });
  for (std::thread& thread : threads) thread.join();
  for (const Registration& result : found) {
    EXPECT_EQ(result.T_place_query.matrix(), found[0].T_place_query.matrix());
    EXPECT_EQ(result.information, found[0].information);
  }
}

TEST(Registration, RealRevisitsAreAcceptedAndOtherPlacesAreNot) {
  REVISIT_NEED_SHARED(kitti, "data/kitti");
  const std::vector<Eigen::Isometry3d> T_world_cam = read_kitti_poses(kitti / "poses/00.txt");
  const Eigen::Isometry3d T_cam_velo = read_kitti_calibration(kitti / "sequences/00/calib.txt");
  const auto scan = [&](int frame) {
    char name[24];
    std::snprintf(name, sizeof name, "%06d.bin", frame);
    return PreparedScan(read_scan(kitti / "sequences/00/velodyne" / name));
  };
  const auto truth = [&](int query, int place) {
    const auto T_world_velo = [&](int frame) {
      return T_world_cam[static_cast<size_t>(frame)] * T_cam_velo;
    };
    return T_world_velo(place).inverse() * T_world_velo(query);
  };
  for (const auto& [query, place] : {std::pair{4501, 52}, {52, 4501}, {88, 94}, {88, 95}}) {
    const Eigen::Isometry3d expected = truth(query, place);
    const Registration found =
        register_scans(scan(query), scan(place), yaw_of(expected) + 2 * kDegree);
    EXPECT_TRUE(found.fits) << query << " " << place << ": " << found.inlier_ratio;
    const Eigen::Vector3d error = found.T_place_query.translation() - expected.translation();
    EXPECT_LT(error.head<2>().norm(), 0.3) << query << " " << place;
    EXPECT_LT(std::abs(yaw_of(expected.inverse() * found.T_place_query)), kDegree);
    EXPECT_FALSE(register_scans(scan(query), scan(850), 0).fits) << query;
  }
}

}  // namespace
}  // namespace revisit
