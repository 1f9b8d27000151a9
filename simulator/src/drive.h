#pragma once

#include <string>
#include <vector>

#include "camera.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::simulation {

struct Drive {
  std::vector<PlanarPose> poses;  // [frame], LiDAR poses
  Eigen::Quaterniond R_level_velo;
  Pose T_cam_velo;          // for the tilted LiDAR
  std::string given_poses;  // file content; "" for a generated route
  std::string calibration;  // content of calib.txt
  CameraModel camera;       // if images are requested
};

/// Throws UsageError, InputError.
/// `site`: poses of the drive of a Site, if not empty.
Drive make_drive(const SimulationConfig& config, const std::vector<Pose>& site = {});

std::string times_text(size_t frames);
/// Returns lines of T_world_cam; the world is the camera's frame at frame 0.
std::string poses_text(const std::vector<Pose>& T_town_velo, const Pose& T_cam_velo);

}  // namespace revisit::simulation
