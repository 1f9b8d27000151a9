#include "loops/virtual_scans.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <utility>

#include "cli/terminal.h"
#include "loops/recording.h"
#include "loops/site_floor.h"
#include "loops/voxel_means.h"
#include "revisit/base/error.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kVoxel = 0.15;        // [m]
constexpr double kBlock = 20;          // edge of the blocks of points [m]
constexpr double kSensorHeight = 1.7;  // above the floor [m]

int block_of(double x) {
  return static_cast<int>(std::floor(x / kBlock));
}

/// One point per voxel, relative to `origin`.
struct Site {
  Eigen::Vector3d origin;
  std::vector<Eigen::Vector3f> points;
};

void stop_if_interrupted() {
  if (interrupted()) throw Interrupted("interrupted while reading the cloud");
}

void add(const PointCloud& cloud, const Pose& T_world_cloud, Progress& progress,
         VoxelMeans& voxels) {
  constexpr int64_t kPiece = 1 << 16;
  for (int64_t done = 0; const Point& p : cloud.points) {
    voxels.add(T_world_cloud * Eigen::Vector3d(p.x, p.y, p.z));
    if (++done % kPiece != 0) continue;
    stop_if_interrupted();
    progress.update(done, std::ssize(cloud.points));
  }
}

Site read_site(const FeatureOptions& options) {
  VoxelMeans voxels(kVoxel);
  PointCloud cloud;
  const std::string extension = options.data.extension().string();
  const bool is_las = extension == ".las" || extension == ".laz";
  Progress progress("averaging", "points", !options.quiet && !is_las);
  if (is_las) {
    FeatureOptions all = options;
    all.every = 1;
    for (const ScanStream next = read_recording(all).next; auto part = next();) {
      part->read(cloud);
      add(cloud, part->pose.value_or(Pose::Identity()), progress, voxels);
    }
  } else {
    read_scan_into(options.data, cloud);
    add(cloud, Pose::Identity(), progress, voxels);
  }
  if (!voxels.origin()) throw InputError(options.data.string(), ": there are no points");
  constexpr double kFar = 1 << 17;  // where float32 has steps of 16 mm [m]
  if (!is_las && voxels.origin()->cwiseAbs().maxCoeff() > kFar)
    warn(str(options.data.string(),
             ": coordinates beyond 131 km are rounded to centimeters or "
             "more; subtract an origin, or write a .las file"));
  stop_if_interrupted();
  Site site{.origin = *voxels.origin(), .points = {}};
  std::vector<int64_t> counts;
  for (const Eigen::Vector3d& point : voxels.points(&counts))
    site.points.push_back((point - site.origin).cast<float>());
  remove_trails(site.points, counts);
  return site;
}

/// A floor has many points at one height, also among walls and on a slope.
void warn_if_tilted(const Site& site, const std::string& name) {
  constexpr float kLayer = 0.5F;            // [m]
  constexpr int64_t kFloor = 5, kMuch = 3;  // of a hilly town 6 %; 6 times the share across z
  std::array<int64_t, 3> fullest{};         // percent
  for (int axis = 0; axis < 3; ++axis) {
    std::map<int, int64_t> layers;
    for (const Eigen::Vector3f& point : site.points)
      fullest[axis] =
          std::max(fullest[axis], ++layers[static_cast<int>(std::floor(point[axis] / kLayer))]);
    fullest[axis] = 100 * fullest[axis] / std::ssize(site.points);
  }
  const auto up = std::ranges::max_element(fullest) - fullest.begin();
  if (fullest[up] > std::max(kFloor, kMuch * fullest[2]))
    warn(str(name, ": ", "xyz"[up], " seems to be up or down, because ", fullest[up],
             " % of the points are in a layer of 0.5 m across it, and ", fullest[2],
             " % across z; rotate the cloud so that z is up"));
}

/// Rows of beams and columns of azimuth. Each point covers its voxel, so that what lies behind a
/// surface is hidden.
class Renderer {
 public:
  Renderer(const Site& site, const Sensor& sensor)
      : origin_(site.origin),
        rows_(sensor.beams > 0 ? sensor.beams : 64),
        top_(sensor.top * std::numbers::pi / 180),
        step_((sensor.top - sensor.bottom) * std::numbers::pi / 180 / (rows_ - 1)),
        range_(sensor.image.max_range) {
    for (const Eigen::Vector3f& p : site.points)
      blocks_[{block_of(p.x()), block_of(p.y())}].push_back(p);
  }

  PointCloud scan(const Pose& T_world_sensor) const {
    const Eigen::Isometry3f T = sensor_of_site(T_world_sensor).cast<float>();
    std::vector<float> depths(static_cast<size_t>(rows_) * kColumns, kNothing);
    std::vector<std::pair<float, Eigen::Vector3f>> hits(depths.size(),
                                                        {kNothing, Eigen::Vector3f::Zero().eval()});
    each_point(T_world_sensor, [&](const Eigen::Vector3f& point) {
      const Eigen::Vector3f p = T * point;
      const float range = p.norm();
      if (range < kNearest || range > range_) return;
      const double row = (top_ - std::asin(p.z() / range)) / step_;
      const double column = (std::numbers::pi - std::atan2(p.y(), p.x())) / kColumnStep;
      const double half = std::atan(kVoxel / 2 / range), flat = std::hypot(p.x(), p.y());
      const double wide = std::atan(kVoxel / 2 / std::max(flat, kVoxel));
      cover(row, half / step_, column, wide / kColumnStep, range, depths);
      if (const int r = static_cast<int>(std::lround(row)); r >= 0 && r < rows_) {
        auto& hit = hits[at(r, static_cast<int>(std::lround(column)))];
        if (range < hit.first) hit = {range, p};
      }
    });
    PointCloud cloud;
    for (size_t i = 0; i < depths.size(); ++i) {
      if (depths[i] == kNothing && hits[i].first == kNothing) continue;
      const bool seen = hits[i].first <= depths[i] + 2 * kVoxel;
      const Eigen::Vector3f p = seen ? hits[i].second : direction(i) * depths[i];
      cloud.points.push_back({p.x(), p.y(), p.z(), 0});
    }
    return cloud;
  }

 private:
  static constexpr int kColumns = 1800;
  static constexpr double kColumnStep = 2 * std::numbers::pi / kColumns;
  static constexpr float kNothing = std::numeric_limits<float>::max(), kNearest = 1;

  static size_t at(int row, int column) {
    return static_cast<size_t>(row) * kColumns +
           static_cast<size_t>((column + kColumns) % kColumns);
  }

  Eigen::Isometry3d sensor_of_site(const Pose& T_world_sensor) const {
    return T_world_sensor.inverse() * Eigen::Translation3d(origin_);
  }

  Eigen::Vector3f direction(size_t pixel) const {
    const double elevation = top_ - static_cast<double>(pixel / kColumns) * step_;
    const double azimuth = std::numbers::pi - static_cast<double>(pixel % kColumns) * kColumnStep;
    return Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth),
                           std::cos(elevation) * std::sin(azimuth), std::sin(elevation))
        .cast<float>();
  }

  template <class Take>
  void each_point(const Pose& T_world_sensor, const Take& take) const {
    const Eigen::Vector3d center = T_world_sensor.translation() - origin_;
    for (int x = block_of(center.x() - range_); x <= block_of(center.x() + range_); ++x)
      for (int y = block_of(center.y() - range_); y <= block_of(center.y() + range_); ++y)
        if (const auto found = blocks_.find({x, y}); found != blocks_.end())
          for (const Eigen::Vector3f& point : found->second) take(point);
  }

  void cover(double row, double tall, double column, double wide, float range,
             std::vector<float>& depths) const {
    const int first = std::max(0, static_cast<int>(std::ceil(row - tall)));
    const int last = std::min(rows_ - 1, static_cast<int>(std::floor(row + tall)));
    const int end = static_cast<int>(std::floor(column + wide));
    for (int r = first; r <= last; ++r)
      for (int c = static_cast<int>(std::ceil(column - wide)); c <= end; ++c) {
        float& depth = depths[at(r, c)];
        depth = std::min(depth, range);
      }
  }

  Eigen::Vector3d origin_;
  std::map<std::pair<int, int>, std::vector<Eigen::Vector3f>> blocks_;
  int rows_;
  double top_, step_, range_;
};

std::vector<Pose> poses_on(const Site& site) {
  std::vector<Pose> poses;
  for (const Eigen::Vector3f& floor : floor_nodes(site.points))
    poses.emplace_back(Eigen::Translation3d(site.origin + floor.cast<double>() +
                                            Eigen::Vector3d(0, 0, kSensorHeight)));
  return poses;
}

std::vector<Pose> poses_along(const fs::path& trajectory) {
  constexpr double kSpacing = 2;  // [m]
  std::vector<Pose> poses;
  for (const Pose& pose : read_timed_poses(trajectory).poses)
    if (poses.empty() || (pose.translation() - poses.back().translation()).norm() >= kSpacing)
      poses.push_back(pose);
  return poses;
}

}  // namespace

Dataset virtual_scans(const FeatureOptions& options, const fs::path& trajectory) {
  const Site site = read_site(options);
  stop_if_interrupted();
  warn_if_tilted(site, options.data.string());
  const std::vector<Pose> poses = trajectory.empty() ? poses_on(site) : poses_along(trajectory);
  if (poses.empty())
    throw InputError(options.data.string(),
                     ": no free floor was found (z must be up); give a trajectory with --poses");
  const auto sensor = std::ranges::find(sensors(), options.image.sensor, &Sensor::name);
  if (sensor == sensors().end())
    throw UsageError("--sensor ", options.image.sensor,
                     ": expected a sensor of --sensor list, because virtual scans need its beams");
  const auto renderer = std::make_shared<const Renderer>(site, *sensor);
  Dataset dataset;
  dataset.name = options.data.stem().string();
  for (const Pose& pose : poses) {
    ScanRef scan;
    scan.file = options.data;
    scan.frame = static_cast<int>(dataset.scans.size());
    scan.pose = pose;
    scan.read = [renderer, pose](PointCloud& cloud) { cloud = renderer->scan(pose); };
    dataset.scans.push_back(std::move(scan));
  }
  dataset.n_poses = std::ssize(dataset.scans);
  return dataset;
}

}  // namespace revisit::cli
