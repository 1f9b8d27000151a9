#pragma once

#include "revisit/evaluation/ground_truth.h"

namespace revisit {

/// Frame i has pose i, and time i unless there are none.
inline Trajectory trajectory_of(const std::vector<Pose>& T_world_cam,
                                const std::vector<double>& times = {}) {
  Dataset dataset;
  dataset.camera_axes = true;
  for (size_t i = 0; i < T_world_cam.size(); ++i) {
    ScanRef& scan = dataset.scans.emplace_back();
    scan.frame = static_cast<int>(i);
    scan.pose = T_world_cam[i];
    if (!times.empty()) scan.time = times.at(i);
  }
  dataset.n_poses = std::ssize(T_world_cam);
  return make_trajectory(dataset);
}

}  // namespace revisit
