#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

namespace revisit::pipeline {

/// Rigid transform from a frame of the vehicle to the world [m]. Which frame is said where it is
/// declared: `T_world_cam` or `T_world_velo`.
using Pose = Eigen::Isometry3d;

/// Reads a KITTI poses file: line i holds the row-major 3x4 `T_world_cam` of frame i (camera: x
/// right, y down, z forward). Throws InputError with file:line.
std::vector<Pose> read_kitti_poses(const std::filesystem::path& file);

/// Reads `Tr` (`T_cam_velo`: velodyne to camera 0) from a KITTI calib.txt. Throws InputError.
Pose read_kitti_calibration(const std::filesystem::path& file);

/// Reads a KITTI times.txt: seconds, one a line. Throws InputError with file:line.
std::vector<double> read_kitti_times(const std::filesystem::path& file);

}  // namespace revisit::pipeline
