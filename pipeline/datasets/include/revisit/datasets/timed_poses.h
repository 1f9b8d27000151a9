#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"

namespace revisit::pipeline {

/// KITTI: the 12 numbers of a 3 x 4 matrix; TUM: time [s] x y z qx qy qz qw; EuRoC: time [ns], x,
/// y, z, qw, qx, qy, qz.
enum class PoseFormat { kKitti, kTum, kEuroc };

/// The axes of poses: a lidar's in a world with z up, or a camera's in a world with KITTI's axes.
enum class PoseFrame { kLidar, kCamera };

/// A file of poses, by time.
struct TimedPoses {
  std::string file;
  std::vector<double> times;  // [s]; empty in KITTI's format, where pose i is that of frame i
  std::vector<Pose> poses;    // as the file has them
};

/// Absent format: told by the count of numbers; lines with commas and times in nanoseconds are
/// EuRoC's. What follows a # is skipped; commas are blanks; TUM's times may be nanoseconds, too. In
/// KITTI's format no line may be left out. Throws InputError naming the file.
TimedPoses read_timed_poses(const std::filesystem::path& file,
                            std::optional<PoseFormat> format = std::nullopt);

/// T_body_lidar: KITTI's calib.txt (Tr), or the rows of a 3 x 4 or 4 x 4 matrix. Throws InputError.
Pose read_extrinsic(const std::filesystem::path& file);

/// The trajectory's pose of each scan. Throws InputError when some have none within `max_gap` [s],
/// or have no time, saying how many.
std::vector<Pose> poses_of(const TimedPoses& timed, std::span<const ScanRef> scans, double max_gap);

/// KITTI's camera sees x to the right, y down, z forward; a lidar x forward, y to the left, z up.
Pose axes_of_camera();

/// T_world_lidar, in a world with KITTI's axes, of a pose as a file has it. `T_body_lidar`: of what
/// else the poses are of; absent: of the lidar, or of a camera that looks ahead.
Pose in_kitti_world(const Pose& pose, PoseFrame frame, const std::optional<Pose>& T_body_lidar);
/// T_world_lidar of KITTI's world, in the world of a file of `frame`.
Pose in_frame(const Pose& T_world_lidar, PoseFrame frame);

}  // namespace revisit::pipeline
