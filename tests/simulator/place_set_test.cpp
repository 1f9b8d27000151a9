#include "lidar.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"
#include "shots.h"
#include "testing.h"
#include "town.h"
#include "traffic.h"
#include "world.h"

namespace revisit {
namespace {

using namespace simulation;
using Vec2 = Eigen::Vector2d;

Streets campus_of(uint64_t seed) {
  return {generate_route("loop", kPlaceRoute, seed), seed};
}

double yaw_of(const Shot& shot) {
  const Eigen::Vector3d forward = shot.T_town_velo.linear().col(0);
  return std::atan2(forward.y(), forward.x());
}

TEST(PlaceShots, AreThoseOfTheHkustData) {
  for (const uint64_t seed : {1u, 2u, 3u}) {
    const Streets campus = campus_of(seed);
    const std::vector<Shot> turned = plan_shots(false, seed, campus.path.points, campus.ground);
    const std::vector<Shot> passed = plan_shots(true, seed, campus.path.points, campus.ground);
    EXPECT_EQ(turned.size(), 77u);
    EXPECT_EQ(passed.size(), 94u);
    const double degree = std::numbers::pi / 180;
    for (size_t i = 1; i < turned.size(); ++i) {
      if (turned[i].place != turned[i - 1].place) continue;
      const double turn = std::remainder(yaw_of(turned[i]) - yaw_of(turned[i - 1]) - 40 * degree,
                                         2 * std::numbers::pi);
      EXPECT_LT(std::abs(turn), 15 * degree);
    }
    for (size_t i = 1; i < passed.size(); ++i) {
      const bool stands = passed[i].T_town_velo.isApprox(passed[i - 1].T_town_velo);
      EXPECT_EQ(stands, passed[i].place == passed[i - 1].place) << i;
    }
    std::vector<Shot> all = turned;
    all.insert(all.end(), passed.begin(), passed.end());
    for (const Shot& a : all) {
      EXPECT_GT(a.T_town_velo.linear()(2, 2), std::cos(3 * degree)) << "upright";
      const Vec2 at = a.T_town_velo.translation().head<2>();
      EXPECT_NEAR(a.T_town_velo.translation().z() - campus.ground.surface_height(at), kTripodHeight,
                  1e-9);
      for (const Shot& b : all) {
        const double apart = (at - b.T_town_velo.translation().head<2>()).norm();
        EXPECT_TRUE(a.place == b.place ? apart <= 1 : apart > 40) << apart;
      }
    }
  }
}

TEST(Passers, AreNearWalkThroughNothingAndAreSeen) {
  const Streets campus = campus_of(1);
  World world = campus.built(1);
  const std::vector<Footprint> objects = world.objects;
  const std::vector<Shot> shots = plan_shots(true, 1, campus.path.points, campus.ground);
  const Scene scene(std::move(world.mesh));
  RayCaster rays(scene);
  const BeamPattern pattern = beam_pattern("vlp16");
  Lidar lidar(pattern, {}, 1);
  int people = 0, cars = 0, hidden = 0;
  for (size_t i = 0; i < shots.size(); i += 3) {
    const Vec2 sensor = shots[i].T_town_velo.translation().head<2>();
    const auto passers =
        make_passers(i, campus.path.points, shots[i].path_point, sensor, campus.ground, objects);
    EXPECT_GE(passers.people, 1);
    EXPECT_LE(passers.people, 4);
    EXPECT_LE(passers.cars, 2);
    people += passers.people, cars += passers.cars;
    std::vector<Footprint> near;
    for (const Footprint& object : objects)
      if (object.distance(sensor) < 30) near.push_back(object);
    for (const Eigen::Vector3f& v : passers.mesh.vertices) {
      const Vec2 at = v.head<2>().cast<double>();
      EXPECT_GT((at - sensor).norm(), 1);
      EXPECT_LT((at - sensor).norm(), 25);
      for (const Footprint& object : near) ASSERT_GT(object.distance(at), 0) << i;
    }
    const auto again =
        make_passers(i, campus.path.points, shots[i].path_point, sensor, campus.ground, objects);
    EXPECT_EQ(passers.mesh.vertices, again.mesh.vertices);
    // A passing object occludes the points behind it.
    rays.place({});
    const PointCloud empty = lidar.scan(1, shots[i].T_town_velo, rays);
    rays.place(passers.mesh);
    const PointCloud with = lidar.scan(1, shots[i].T_town_velo, rays);
    std::set<std::tuple<float, float, float>> before;
    for (const Point& p : empty.points) before.insert({p.x, p.y, p.z});
    int changed = 0;
    for (const Point& p : with.points) changed += !before.contains({p.x, p.y, p.z});
    hidden += changed < 30;
    EXPECT_LT(changed, 8000) << "small objects";
  }
  EXPECT_GT(people, 40);
  EXPECT_GT(cars, 15);
  EXPECT_LE(hidden, 1);
}

using Voxel = std::tuple<int, int, int>;

/// Returns the 30 cm voxels with points above the ground, in the town frame.
std::set<Voxel> voxels(const PointCloud& cloud, const Pose& T_town_velo) {
  std::set<Voxel> taken;
  for (const Point& p : cloud.points) {
    if (p.z < -1 || std::hypot(p.x, p.y) > 20) continue;
    const Eigen::Vector3d q = T_town_velo * Eigen::Vector3d(p.x, p.y, p.z) / 0.3;
    taken.insert({static_cast<int>(std::floor(q.x())), static_cast<int>(std::floor(q.y())),
                  static_cast<int>(std::floor(q.z()))});
  }
  return taken;
}

double overlap(const std::set<Voxel>& a, const std::set<Voxel>& b) {
  double both = 0;
  for (const Voxel& v : a) both += b.contains(v);
  return both / static_cast<double>(std::min(a.size(), b.size()));
}

TEST(SimulatePlaces, WritesAFolderPerPlaceThatIsReadWithItsTruth) {
  const TempDir dir, other;
  SimulationConfig config;
  config.output = dir / "rotation";
  config.threads = 1;
  const SimulationSummary summary = simulate_places(config, false);
  EXPECT_EQ(summary.scans, 77);
  EXPECT_EQ(summary.kept, 0);
  EXPECT_GT(summary.mean_points, 15000);

  const Dataset dataset = open_dataset(dir.path(), "rotation");
  ASSERT_EQ(dataset.scans.size(), 77u);
  EXPECT_TRUE(dataset.has_places());
  std::map<std::string, int> count;
  for (const ScanRef& scan : dataset.scans) ++count[scan.place];
  EXPECT_EQ(count.size(), 7u);
  for (const auto& [place, scans] : count) EXPECT_EQ(scans, 11) << place;

  const Streets campus = campus_of(1);
  const std::vector<Shot> shots = plan_shots(false, 1, campus.path.points, campus.ground);
  const auto seen = [&](size_t i) {
    return voxels(read_scan(dataset.scans[i].file), shots[i].T_town_velo);
  };
  EXPECT_GT(overlap(seen(0), seen(4)), 0.4);
  EXPECT_GT(overlap(seen(60), seen(65)), 0.4);
  EXPECT_LT(overlap(seen(0), voxels(read_scan(dataset.scans[4].file), shots[0].T_town_velo)), 0.3)
      << "but for the turn";

  std::ifstream csv(dir / "rotation/scans.csv");
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line, "file,place,x_m,y_m,z_m,yaw_deg,people,cars");
  for (size_t i = 0; i < shots.size(); ++i) {
    ASSERT_TRUE(std::getline(csv, line));
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line);
    std::string file, place;
    double x = 0, y = 0, z = 0, yaw = 0;
    fields >> file >> place >> x >> y >> z >> yaw;
    EXPECT_EQ(dir / "rotation" / file, dataset.scans[i].file);
    EXPECT_EQ(place, dataset.scans[i].place);
    EXPECT_NEAR(x, shots[i].T_town_velo.translation().x(), 1e-3);
    EXPECT_NEAR(yaw, yaw_of(shots[i]) * 180 / std::numbers::pi, 0.01);
  }

  // Two threads give the same bytes; existing files are kept.
  config.output = other.path();
  config.threads = 2;
  simulate_places(config, false);
  for (const char* file : {"place_1/0000.bin", "place_7/0010.bin", "scans.csv"})
    EXPECT_TRUE(read_file(dir / (std::string("rotation/") + file)) == read_file(other / file))
        << file;
  fs::remove(other / "place_3/0004.bin");
  EXPECT_EQ(simulate_places(config, false).kept, 76);
  EXPECT_TRUE(fs::exists(other / "place_3/0004.bin"));

  EXPECT_THROW(simulate_places(config, true), UsageError) << "other settings";
  config.overwrite = true;
  EXPECT_EQ(simulate_places(config, true).scans, 94);
  EXPECT_EQ(open_dataset(other.path(), "").scans.size(), 94u);
}

TEST(SimulatePlaces, StopsBetweenScansAndNeverTouchesARecording) {
  const TempDir dir;
  SimulationConfig config;
  config.output = dir / "places";
  config.threads = 1;
  int asked = 0;
  EXPECT_THROW(simulate_places(config, false, {}, [&] { return ++asked == 2; }), Interrupted);
  EXPECT_EQ(open_dataset(dir / "places", "").scans.size(), 2u);

  for (const char* file : {"place_2/cloud.pcd", "scans.csv", "simulation.txt"}) {
    const TempDir real;
    write_file(real / file, "precious");
    config.output = real.path();
    config.overwrite = true;
    EXPECT_THROW(simulate_places(config, false), UsageError) << file;
    EXPECT_EQ(read_file(real / file), "precious");
  }
  config.output.clear();
  EXPECT_THROW(simulate_places(config, false), UsageError);
  config.output = dir / "other";
  config.dropout = 1;
  EXPECT_THROW(simulate_places(config, false), UsageError);
}

}  // namespace
}  // namespace revisit
