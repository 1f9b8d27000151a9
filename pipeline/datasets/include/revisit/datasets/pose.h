#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <string>
#include <vector>

namespace revisit {

/// Rigid transform from a vehicle frame to the world [m]: `T_world_cam` or `T_world_velo`.
using Pose = Eigen::Isometry3d;

/// Reads a KITTI poses file: line i holds the row-major 3x4 `T_world_cam` of frame i (camera: x
/// right, y down, z forward). Throws InputError with file:line.
std::vector<Pose> read_kitti_poses(const std::filesystem::path& file);

/// Reads `Tr` (`T_cam_velo`: velodyne to camera 0) from a KITTI calib.txt. Throws InputError.
Pose read_kitti_calibration(const std::filesystem::path& file);

/// Reads the projection matrix of a camera from a KITTI calib.txt; `name` is "P0" for the left gray
/// camera. Pixel = P * (point in camera 0, 1). Throws InputError if it is missing or implausible.
Eigen::Matrix<double, 3, 4> read_kitti_projection(const std::filesystem::path& file,
                                                  const std::string& name);

/// Reads a KITTI times.txt: seconds, one value per line. Throws InputError with file:line.
std::vector<double> read_kitti_times(const std::filesystem::path& file);

}  // namespace revisit
