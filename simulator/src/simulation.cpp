#include "revisit/simulation/simulation.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "camera.h"
#include "data_set.h"
#include "lidar.h"
#include "revisit/base/error.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"
#include "traffic.h"
#include "world.h"

namespace revisit {
namespace {

using namespace simulation;

NoiseModel noise_of(const SimulationConfig& config) {
  return {config.range_noise, config.dropout};
}

void check(const SimulationConfig& config) {
  const auto refuse = [](const auto&... parts) { throw UsageError(parts...); };
  if (config.output.empty()) refuse("no output folder given");
  const std::string& name = config.sequence;
  if (name.empty() || name == "." || name == ".." || name.find('/') != std::string::npos)
    refuse("sequence '", name, "': expected the name of a folder, e.g. 00");
  if (config.every < 1) refuse("every ", config.every, "th frame: expected 1 or more");
  if (config.threads < 0) refuse(config.threads, " threads: expected 0 (all) or more");
  simulation::check(noise_of(config));
  const auto within = [&](const char* what, double value, double low, double high) {
    if (!(value >= low && value <= high))
      refuse(what, " is ", value, ": expected ", low, " to ", high);
  };
  within("traffic", config.traffic, 0, 10);
  within("sensor height", config.sensor_height.value_or(1), 0.5, 5);
  within("sensor pitch", config.sensor_pitch, -45, 45);
  within("sensor roll", config.sensor_roll, -45, 45);
  if (config.camera && !(config.image_scale >= 0.1 && config.image_scale <= 1))
    refuse("pictures of ", config.image_scale, " times KITTI's size: expected 0.1 to 1");
  if (config.calibration && !config.poses)
    refuse("a calibration belongs to given poses; a generated route has its own");
  const SimulationConfig usual;
  if (scenery_of(config.surroundings).site &&
      (config.poses || config.camera || config.route != usual.route ||
       config.length != usual.length || config.traffic != usual.traffic))
    refuse("surroundings ", config.surroundings, " have a drive of their own, no traffic and no ",
           "camera: they take no poses, route, length, traffic or camera");
}

std::set<int> wanted_frames(const SimulationConfig& config, int frames) {
  const int last = config.last_frame.value_or(frames - 1);
  if (config.first_frame < 0 || last < config.first_frame || last >= frames)
    throw UsageError("frames ", config.first_frame, " to ", last, ": the drive has frames 0 to ",
                     frames - 1);
  std::set<int> wanted;
  for (int64_t frame = config.first_frame; frame <= last; frame += config.every)
    wanted.insert(wanted.end(), static_cast<int>(frame));
  return wanted;
}

/// Stands `height` above the ground, perpendicular to it, with the vehicle's heading.
Pose stand(const PlanarPose& pose, const Ground& ground, double height) {
  const Eigen::Vector2d p(pose.x, pose.y);
  const Eigen::Vector3d up = ground.normal(p);
  const Eigen::Vector3d left =
      up.cross(Eigen::Vector3d(std::cos(pose.yaw), std::sin(pose.yaw), 0)).normalized();
  Pose T = Pose::Identity();
  T.linear().col(0) = left.cross(up);
  T.linear().col(1) = left;
  T.linear().col(2) = up;
  T.translation() = Eigen::Vector3d(p.x(), p.y(), ground.height(p)) + height * up;
  return T;
}

/// After the last frame, the previous motion continues.
Pose motion_from(const std::vector<Pose>& poses, size_t frame) {
  if (poses.size() < 2) return Pose::Identity();
  const size_t from = std::min(frame, poses.size() - 2);
  return poses[from].inverse() * poses[from + 1];
}

struct Vehicle {
  std::unique_ptr<RayCaster> surroundings;
  std::unique_ptr<Lidar> lidar;
  std::unique_ptr<Camera> camera;  // or null
};

}  // namespace

SimulationSummary simulate(const SimulationConfig& config,
                           const std::function<void(int64_t, int64_t)>& progress,
                           const std::function<bool()>& stop) {
  check(config);
  const Scenery& scenery = scenery_of(config.surroundings);
  const BeamPattern pattern = beam_pattern(config.sensor);
  Site site;
  if (scenery.site) site = scenery.site(config.seed);
  const Drive drive = make_drive(config, site.T_site_floor);
  const std::set<int> wanted = wanted_frames(config, static_cast<int>(drive.poses.size()));
  DataSet data(config, drive);
  const std::set<int> there = data.open(wanted, config.overwrite);

  auto lap = stopwatch();
  const Path path = resample(drive.poses);
  const RoadMap roads(drive.poses, path.points, scenery.oncoming);
  const Ground ground(config.seed, roads, scenery);
  std::vector<Pose> T_town_velo;
  const double height = config.sensor_height.value_or(scenery.sensor_height);
  for (size_t i = 0; i < drive.poses.size(); ++i) {
    T_town_velo.push_back(scenery.site ? site.T_site_floor[i] * Eigen::Translation3d(0, 0, height)
                                       : stand(drive.poses[i], ground, height));
    T_town_velo.back().linear() *= drive.R_level_velo.toRotationMatrix();
  }
  data.write_frame(
      drive.given_poses.empty() ? poses_text(T_town_velo, drive.T_cam_velo) : drive.given_poses,
      drive.calibration, times_text(drive.poses.size()));

  SimulationSummary summary;
  summary.kept = static_cast<int64_t>(there.size());
  summary.scans = summary.kept;
  for (size_t i = 1; i < path.points.size(); ++i) {
    const double step = (path.points[i].position - path.points[i - 1].position).norm();
    if (step <= 2 * kPathStep) summary.path_meters += step;
  }
  std::vector<int> missing;
  std::set_difference(wanted.begin(), wanted.end(), there.begin(), there.end(),
                      std::back_inserter(missing));
  const auto total = static_cast<int64_t>(wanted.size());
  if (progress) progress(summary.scans, total);

  if (!missing.empty()) {
    const Scene scene(scenery.site
                          ? site.mesh
                          : build_world(config.seed, path.points, roads, ground, scenery).mesh);
    const Traffic traffic(config.seed, path.points, ground, scenery, config.traffic);
    std::optional<Textures> textures;
    if (config.camera) textures.emplace();
    summary.triangles = static_cast<int64_t>(scene.mesh().triangles.size());
    summary.build_seconds = lap() / 1000;

    const int threads = threads_for(config.threads, static_cast<int64_t>(missing.size()));
    std::vector<Vehicle> vehicles;  // [thread]
    for (int i = 0; i < threads; ++i) {
      vehicles.push_back({std::make_unique<RayCaster>(scene),
                          std::make_unique<Lidar>(pattern, noise_of(config), config.seed),
                          nullptr});
      if (config.camera)
        vehicles.back().camera = std::make_unique<Camera>(drive.camera, *textures, config.seed);
    }
    const auto take = [&](int64_t item, int thread) {
      const int frame = missing[static_cast<size_t>(item)];
      const auto at = static_cast<size_t>(frame);
      const double time = frame * kFramePeriod;
      const Vehicle& vehicle = vehicles[static_cast<size_t>(thread)];
      vehicle.surroundings->place(
          scenery.site ? site.differing(at)
                       : traffic.at(time, path.point_of_pose[at], pattern.max_range));
      std::function<Eigen::Isometry3d(double time)> motion;
      if (config.rolling_shutter)
        motion = constant_velocity(motion_from(T_town_velo, at), kFramePeriod);
      const PointCloud scan =
          vehicle.lidar->scan(frame, T_town_velo[at], *vehicle.surroundings, motion);
      (motion ? write_pcd_scan : write_kitti_scan)(data.scan_file(frame), scan);
      if (!vehicle.camera) return;
      const Light light = light_at(config.seed, time, config.changing_light);
      write_gray_png(data.image_file(frame),
                     vehicle.camera->picture(frame, T_town_velo[at], light, *vehicle.surroundings));
    };
    run_scans(static_cast<int64_t>(missing.size()), threads, data.scan_file(0).parent_path(), take,
              progress, stop, summary);
  }
  std::vector<std::filesystem::path> files;
  for (const int frame : wanted) files.push_back(data.scan_file(frame));
  summary.mean_points = mean_points(files);
  return summary;
}

}  // namespace revisit
