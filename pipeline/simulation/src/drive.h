#pragma once

#include <string>
#include <vector>

#include "camera.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"
#include "route.h"

namespace revisit::pipeline::simulation {

/// Where the vehicle goes, and the text of the KITTI files that say so.
struct Drive {
  std::vector<PlanarPose> poses;    // [frame], of the LiDAR
  Eigen::Quaterniond R_level_velo;  // tilt of the LiDAR
  Pose T_cam_velo;                  // of the tilted LiDAR
  std::string given_poses;  // content of the poses file driven along; "" for a generated route
  std::string calibration;  // content of calib.txt
  CameraModel camera;       // when pictures are asked for
};

/// The drive that the configuration asks for. Throws UsageError, InputError.
Drive make_drive(const SimulationConfig& config);

/// The content of times.txt.
std::string times_text(size_t frames);
/// The content of a KITTI poses file with T_world_cam(i) for sensor poses T_town_velo[i]; the world
/// is the camera's frame at frame 0.
std::string poses_text(const std::vector<Pose>& T_town_velo, const Pose& T_cam_velo);

}  // namespace revisit::pipeline::simulation
