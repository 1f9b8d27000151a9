#include "revisit/loops/local_map.h"

#include "revisit/base/error.h"
#include "revisit/recognition/mount.h"
#include "revisit/registration/compact_cloud.h"

namespace revisit::pipeline {
namespace {

constexpr double kVoxel = 0.25, kRange = 80;  // [m]: a ring sees no farther
constexpr double kScans = 20;                 // kept at most, so that a halt adds none

}  // namespace

LocalMap::LocalMap(double metres) : metres_(metres) {
  if (!(metres >= 1 && metres <= 200))
    throw UsageError("local map: expected 1 to 200 m, found ", metres);
}

PointsView LocalMap::add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor) {
  const double moved =
      last_ ? (T_world_sensor.translation() - last_->translation()).norm() : metres_;
  while (!scans_.empty() && scans_.front().along < along_ + moved - metres_) scans_.pop_front();
  copy_points(scan, cloud_);
  PointCloud here = thinned_cloud(cloud_, kVoxel, kRange);
  cloud_.points = here.points;
  for (const Scan& earlier : scans_) {
    moved_ = earlier.cloud;
    transform(T_world_sensor.inverse() * earlier.T_world_sensor, moved_);
    cloud_.points.insert(cloud_.points.end(), moved_.points.begin(), moved_.points.end());
  }
  if (moved >= metres_ / kScans) {
    along_ += moved;
    last_ = T_world_sensor;
    scans_.push_back({std::move(here), T_world_sensor, along_});
  }
  cloud_ = thinned_cloud(cloud_, kVoxel, kRange);
  return view_of(cloud_);
}

}  // namespace revisit::pipeline
