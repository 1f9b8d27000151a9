#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>

#include "data_set.h"
#include "lidar.h"
#include "random.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"
#include "road_map.h"
#include "shots.h"
#include "traffic.h"
#include "world.h"

namespace revisit {
namespace {

using namespace simulation;
namespace fs = std::filesystem;

fs::path scan_name(const Shot& shot) {
  char name[40];
  std::snprintf(name, sizeof name, "place_%d/%04d.bin", shot.place + 1, shot.number);
  return name;
}

OutputFolder::Files scans_there(const fs::path& root) {
  OutputFolder::Files files;
  for (int place = 0; place < kPlaces; ++place) {
    std::error_code error;
    const fs::path folder = (root / scan_name({place, 0, {}, 0})).parent_path();
    for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
      if (is_scan_file_name(it->path())) files.insert(it->path());
  }
  return files;
}

std::string settings_of(const SimulationConfig& config, bool objects) {
  return str("version: ", kWorldVersion, "\nplaces: ", objects ? "objects" : "rotation",
             ", sensor vlp16\n", "range-noise: ", exact(config.range_noise),
             "\ndropout: ", exact(config.dropout), "\nseed: ", config.seed, "\n");
}

std::string truth_csv(const std::vector<Shot>& shots, const std::vector<Passers>& passers) {
  std::string text = "file,place,x_m,y_m,z_m,yaw_deg,people,cars\n";
  for (size_t i = 0; i < shots.size(); ++i) {
    const Eigen::Vector3d p = shots[i].T_town_velo.translation();
    const Eigen::Vector3d forward = shots[i].T_town_velo.linear().col(0);
    char numbers[160];
    std::snprintf(numbers, sizeof numbers, "%.4f,%.4f,%.4f,%.3f,%d,%d\n", p.x(), p.y(), p.z(),
                  std::atan2(forward.y(), forward.x()) * 180 / std::numbers::pi, passers[i].people,
                  passers[i].cars);
    const fs::path file = scan_name(shots[i]);
    text += str(file.string(), ",", file.parent_path().string(), ",", numbers);
  }
  return text;
}

}  // namespace

SimulationSummary simulate_places(const SimulationConfig& config, bool objects,
                                  const std::function<void(int64_t, int64_t)>& progress,
                                  const std::function<bool()>& stop) {
  if (config.output.empty()) throw UsageError("no output folder given");
  if (config.threads < 0) throw UsageError(config.threads, " threads: expected 0 (all) or more");
  const NoiseModel noise{config.range_noise, config.dropout};
  check(noise);

  const std::vector<PlanarPose> route = generate_route("loop", kPlaceRoute, config.seed);
  const Path path = resample(route);
  const Scenery& scenery = scenery_of("town");
  const RoadMap roads(route, path.points, scenery.oncoming);
  const Ground ground(config.seed, roads, scenery);
  const std::vector<Shot> shots = plan_shots(objects, config.seed, path.points, ground);

  OutputFolder::Files wanted;
  for (const Shot& shot : shots) wanted.insert(config.output / scan_name(shot));
  const fs::path truth = config.output / "scans.csv";
  const OutputFolder folder(config.output / "simulation.txt", settings_of(config, objects));
  const OutputFolder::Files there =
      folder.open(wanted, scans_there(config.output), {truth}, config.overwrite);

  auto lap = stopwatch();
  World world = build_world(config.seed, path.points, roads, ground, scenery);
  std::vector<Passers> passers(shots.size());
  if (objects)
    for (size_t i = 0; i < shots.size(); ++i)
      passers[i] =
          make_passers(random_bits(config.seed, 0x73686f74, i), path.points, shots[i].path_point,
                       shots[i].T_town_velo.translation().head<2>(), ground, world.objects);
  write_text(truth, truth_csv(shots, passers));
  const Scene scene(std::move(world.mesh));

  SimulationSummary summary;
  summary.kept = summary.scans = static_cast<int64_t>(there.size());
  summary.triangles = static_cast<int64_t>(scene.mesh().triangles.size());
  summary.build_seconds = lap() / 1000;
  const auto total = static_cast<int64_t>(shots.size());
  if (progress) progress(summary.scans, total);

  std::vector<size_t> missing;
  for (size_t i = 0; i < shots.size(); ++i)
    if (!there.contains(config.output / scan_name(shots[i]))) missing.push_back(i);
  const BeamPattern pattern = beam_pattern("vlp16");
  const int threads = threads_for(config.threads, static_cast<int64_t>(missing.size()));
  std::vector<std::unique_ptr<RayCaster>> casters;  // [thread]
  std::vector<std::unique_ptr<Lidar>> lidars;       // [thread]
  for (int i = 0; i < threads; ++i) {
    casters.push_back(std::make_unique<RayCaster>(scene));
    lidars.push_back(std::make_unique<Lidar>(pattern, noise, config.seed));
  }
  const auto take = [&](int64_t item, int thread) {
    const size_t i = missing[static_cast<size_t>(item)];
    RayCaster& caster = *casters[static_cast<size_t>(thread)];
    caster.place(passers[i].mesh);
    const int frame = static_cast<int>(i) + (objects ? 1000 : 0);
    write_kitti_scan(config.output / scan_name(shots[i]), lidars[static_cast<size_t>(thread)]->scan(
                                                              frame, shots[i].T_town_velo, caster));
  };
  run_scans(static_cast<int64_t>(missing.size()), threads, config.output, take, progress, stop,
            summary);
  summary.mean_points = mean_points(std::vector<fs::path>(wanted.begin(), wanted.end()));
  return summary;
}

}  // namespace revisit
