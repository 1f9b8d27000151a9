#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"

namespace revisit {

/// KITTI: the 12 values of a 3 x 4 matrix; TUM: time [s] x y z qx qy qz qw; EuRoC: time [ns], x, y,
/// z, qw, qx, qy, qz.
enum class PoseFormat { kKitti, kTum, kEuroc };

/// Axes of poses: of a lidar in a world with z up, or of a camera in a world with KITTI's axes.
enum class PoseFrame { kLidar, kCamera };

struct TimedPoses {
  std::string file;
  std::vector<double> times;  // [s]; empty in KITTI's format, where pose i belongs to frame i
  std::vector<Pose> poses;    // as stored
};

/// An absent format is detected from the number of values per line; lines with commas and times in
/// nanoseconds are EuRoC's. Text after a # is ignored, commas are blanks. TUM's times may be
/// nanoseconds. In KITTI's format no line may be missing. Throws InputError with the file.
TimedPoses read_timed_poses(const std::filesystem::path& file,
                            std::optional<PoseFormat> format = std::nullopt);

/// T_body_lidar: KITTI's calib.txt (Tr), or a 3 x 4 or 4 x 4 matrix. Throws InputError.
Pose read_extrinsic(const std::filesystem::path& file);

/// Throws InputError with the number of scans without a time or a pose within `max_gap` [s].
std::vector<Pose> poses_of(const TimedPoses& timed, std::span<const ScanRef> scans, double max_gap);

/// T_camera_lidar: lidar x forward, y left, z up; KITTI's camera x right, y down, z forward.
Pose axes_of_camera();

/// T_world_lidar in a world with KITTI's axes. `T_body_lidar` is the extrinsic of the body that the
/// poses are of; absent: the lidar, or a forward-looking camera.
Pose in_kitti_world(const Pose& pose, PoseFrame frame, const std::optional<Pose>& T_body_lidar);
/// Converts T_world_lidar from KITTI's world to the world of a file of `frame`.
Pose in_frame(const Pose& T_world_lidar, PoseFrame frame);

}  // namespace revisit
