#include "revisit/loops/local_map.h"

#include "revisit/base/error.h"
#include "revisit/recognition/mount.h"
#include "revisit/registration/compact_cloud.h"

namespace revisit::pipeline {
namespace {

constexpr double kVoxel = 0.25, kRange = 80;  // [m]: a ring sees no farther

}  // namespace

LocalMap::LocalMap(double metres) : metres_(metres) {
  if (!(metres >= 1 && metres <= 200))
    throw UsageError("local map: expected 1 to 200 m, found ", metres);
}

PointsView LocalMap::add(const PointsView& scan, const Eigen::Isometry3d& T_world_sensor) {
  copy_points(scan, cloud_);
  const double along =
      scans_.empty()
          ? 0
          : scans_.back().along +
                (T_world_sensor.translation() - scans_.back().T_world_sensor.translation()).norm();
  while (!scans_.empty() && scans_.front().along < along - metres_) scans_.pop_front();
  scans_.push_back({thinned_cloud(cloud_, kVoxel, kRange), T_world_sensor, along});
  cloud_.points.clear();
  for (const Scan& earlier : scans_) {
    PointCloud moved = earlier.cloud;
    transform(T_world_sensor.inverse() * earlier.T_world_sensor, moved);
    cloud_.points.insert(cloud_.points.end(), moved.points.begin(), moved.points.end());
  }
  cloud_ = thinned_cloud(cloud_, kVoxel, kRange);
  return view_of(cloud_);
}

}  // namespace revisit::pipeline
