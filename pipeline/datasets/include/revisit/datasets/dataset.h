#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/datasets/scan_file.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Rigid transform from a vehicle frame to the world [m]: `T_world_cam` or `T_world_velo`. The
/// world has the axes of the file that the pose is from: nothing converts them.
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

/// A scan that is read on demand.
struct ScanRef {
  std::filesystem::path file;  ///< names the scan in messages
  int frame = 0;  ///< index in the sequence; KITTI: the number in the file name (gaps are allowed)
  std::optional<Pose> pose;    ///< T_world_cam for KITTI, else T_world_lidar; absent if unknown
  std::optional<double> time;  ///< [s]
  std::string place;           ///< in a data set sorted by places; else ""
  /// Reads the points of a scan without a file of its own, e.g. in a bag; `file` only names it.
  /// Throws InputError.
  std::function<void(PointCloud&)> read;
  std::string checksum;  ///< of these points
  /// Convention of the file's times of points; absent: decided from the file alone.
  std::optional<PointTimes> point_times;
};

/// Reads the scan's file, or calls `read`. Throws InputError, also for a scan without a finite
/// point except the origin.
PointCloud read_scan(const ScanRef& scan);
/// Reuses the memory of `cloud`.
void read_scan_into(const ScanRef& scan, PointCloud& cloud);

/// A sequence, or any folder of scans, in frame order.
struct Dataset {
  std::string name;            ///< from the folder, for display
  std::string sequence;        ///< e.g. "00"; "" for a plain folder
  std::vector<ScanRef> scans;  ///< in frame order
  /// Counts frames whose scans are missing or skipped, too; 0 without poses.
  int64_t n_poses = 0;
  /// The world has KITTI's camera axes: x right, y down, z forward. Else it has z up.
  bool camera_axes = false;
  std::vector<std::string> warnings;  ///< what was skipped or missing
  std::string point_times;  ///< PointTimes::text; "" if unknown, or if files have no times
  /// Every scan has a pose.
  bool has_poses() const {
    for (const ScanRef& scan : scans)
      if (!scan.pose) return false;
    return !scans.empty();
  }
  bool has_places() const { return !scans.empty() && !scans[0].place.empty(); }  ///< sorted
};

/// Opens a KITTI odometry sequence, a folder per place, or a plain folder of .bin/.pcd/.ply files.
///
/// `root` may be
/// - the KITTI root (`sequences/NN/velodyne`, `poses/NN.txt`); `sequence` may be "" if only one has
///   scans; or one sequence folder (`velodyne/`, `poses.txt` or `../../poses/NN.txt`);
/// - a set of places, as the HKUST data can be sorted: a folder of scan files per place
///   (`place_1/*.bin`, `library/*.pcd`...), without poses. Frames are counted from 0 through all
///   places, in natural order of the names. `sequence` names one of several such sets;
/// - a folder of scan files (no poses).
/// Throws InputError with the paths searched and the sequences found.
Dataset open_dataset(const std::filesystem::path& root, const std::string& sequence,
                     bool needs_poses = false);

/// Decides the convention of the times of points from the first files and sets it in all scans. For
/// `unit` see point_times_of().
void find_point_times(Dataset& dataset, const std::string& unit = "auto");

/// Replaces each scan's file by the image of its frame, e.g. 000123.png. If `folder` is empty, the
/// image_0 (left, gray) of a KITTI sequence is used. Throws InputError for a missing folder, names
/// that are not numbers, and scans without an image (with the first of them).
Dataset camera_images(const Dataset& dataset, const std::filesystem::path& folder = {});

/// Opens a folder of .png images named by frame numbers, without poses. Throws as camera_images().
Dataset image_folder(const std::filesystem::path& folder);

/// Poses of a trajectory file.
struct TimedPoses {
  std::string file;           ///< for messages
  std::vector<double> times;  ///< [s]; empty in KITTI's format, where pose i belongs to frame i
  std::vector<Pose> poses;    ///< as stored
};

/// `format`: "kitti", the 12 values of a 3 x 4 matrix; "tum", time [s] x y z qx qy qz qw; "euroc",
/// time [ns], x, y, z, qw, qx, qy, qz; "": detected from the number of values per line; lines with
/// commas and times in nanoseconds are EuRoC's. Text after a # is ignored, commas are blanks. TUM's
/// times may be nanoseconds. In KITTI's format no line may be missing. Throws InputError with the
/// file, UsageError for another format.
TimedPoses read_timed_poses(const std::filesystem::path& file, const std::string& format = "");

/// T_body_lidar: KITTI's calib.txt (Tr), or a 3 x 4 or 4 x 4 matrix. Throws InputError.
Pose read_extrinsic(const std::filesystem::path& file);

/// Throws InputError with the number of scans without a time or a pose within `max_gap` [s].
std::vector<Pose> poses_of(const TimedPoses& timed, std::span<const ScanRef> scans, double max_gap);

/// T_camera_lidar: lidar x forward, y left, z up; KITTI's camera x right, y down, z forward.
Pose axes_of_camera();

}  // namespace revisit
