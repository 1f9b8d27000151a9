#include "local_map.h"

#include "revisit/base/error.h"
#include "revisit/registration/registration.h"

namespace revisit {
namespace {

constexpr double kVoxel = 0.25, kRange = 80;  // [m]; the maximum range of rings
constexpr int kStepsPerMeter = 1024;
constexpr int kVoxelBits = 8;
constexpr int kMaxStepsFromOrigin = 1 << 30;
static_assert(kStepsPerMeter * kVoxel == 1 << kVoxelBits);
constexpr double kMaxScans = 20;  // bounds their number, so that a halt adds none

uint64_t voxel_of(const Eigen::Vector3i& point) {
  constexpr int kAxisBits = 21;
  uint64_t key = 0;
  for (const int x : point)
    key = key << kAxisBits | (static_cast<uint64_t>(x >> kVoxelBits) & ((1 << kAxisBits) - 1));
  return key;
}

}  // namespace

void LocalMap::clear() {
  scans_.clear();
  voxels_.clear();
  along_ = 0;
}

PointsView LocalMap::add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor) {
  if (!T_world_sensor.matrix().allFinite())
    throw UsageError("local map: a pose has numbers that are not finite");
  double moved = last_ ? (T_world_sensor.translation() - last_->translation()).norm() : meters_;
  if (!(moved <= meters_)) {  // a gap or a jump of the odometry; may be infinite
    clear();
    moved = meters_;
  }
  while (!scans_.empty() && scans_.front().along < along_ + moved - meters_) {
    remove(scans_.front().points);
    scans_.pop_front();
  }
  if (scans_.empty()) origin_ = T_world_sensor.translation();
  Eigen::Isometry3d T_origin_sensor = T_world_sensor;
  T_origin_sensor.pretranslate(-origin_);
  copy_points(scan, cloud_);
  std::vector<Eigen::Vector3i> points;
  for (const Point& p : thinned_cloud(cloud_, kVoxel, kRange).points) {
    const Eigen::Vector3d at = T_origin_sensor * Eigen::Vector3d(p.x, p.y, p.z) * kStepsPerMeter;
    if (at.cwiseAbs().maxCoeff() < kMaxStepsFromOrigin)
      points.emplace_back(at.array().round().cast<int>());
  }
  for (const Eigen::Vector3i& point : points) {
    Voxel& voxel = voxels_[voxel_of(point)];
    voxel.sum += point.cast<int64_t>();
    ++voxel.points;
  }
  const Eigen::Isometry3d T_sensor_origin = T_origin_sensor.inverse();
  cloud_.points.clear();
  for (const auto& [key, voxel] : voxels_) {
    const Eigen::Vector3d p =
        T_sensor_origin *
        (voxel.sum.cast<double>() / (kStepsPerMeter * static_cast<double>(voxel.points)));
    if (p.squaredNorm() > kRange * kRange) continue;
    const Eigen::Vector3f at = p.cast<float>();
    cloud_.points.push_back({at.x(), at.y(), at.z(), 0});
  }
  if (moved >= meters_ / kMaxScans) {
    along_ += moved;
    last_ = T_world_sensor;
    scans_.push_back({std::move(points), along_});
  } else {
    remove(points);
  }
  return view_of(cloud_);
}

void LocalMap::remove(const std::vector<Eigen::Vector3i>& points) {
  for (const Eigen::Vector3i& point : points) {
    const auto voxel = voxels_.find(voxel_of(point));
    voxel->second.sum -= point.cast<int64_t>();
    if (--voxel->second.points == 0) voxels_.erase(voxel);
  }
}

}  // namespace revisit
