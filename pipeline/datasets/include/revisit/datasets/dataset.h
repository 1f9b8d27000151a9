#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/pose.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {

struct ScanRef {
  std::filesystem::path file;
  int frame = 0;  // index in the sequence; KITTI: the number in the file name (gaps are allowed)
  std::optional<Pose> pose;    // T_world_cam for KITTI, as stored; absent without ground truth
  std::optional<double> time;  // [s]
  std::string place;           // in a data set sorted by places; else ""
  /// Reads the points of a scan without a file of its own, e.g. in a bag; `file` only names it.
  /// Throws InputError.
  std::function<void(PointCloud&)> read;
  std::string checksum;  // of these points
};

/// Reads the scan's file, or calls `read`. Throws InputError, also for a scan without a finite
/// point except the origin.
PointCloud read_scan(const ScanRef& scan);
/// Reuses the memory of `cloud`.
void read_scan_into(const ScanRef& scan, PointCloud& cloud);

/// A sequence, or any folder of scans, in frame order.
struct Dataset {
  std::string name;
  std::string sequence;  // e.g. "00"; "" for a plain folder
  std::vector<ScanRef> scans;
  /// Counts frames whose scans are missing or skipped, too; 0 without poses.
  int64_t n_poses = 0;
  std::vector<std::string> warnings;
  bool has_poses() const {
    for (const ScanRef& scan : scans)
      if (!scan.pose) return false;
    return !scans.empty();
  }
  bool has_places() const { return !scans.empty() && !scans[0].place.empty(); }
};

struct DatasetNeeds {
  bool poses = false;
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
                     const DatasetNeeds& needs = {});

/// Replaces each scan's file by the image of its frame, e.g. 000123.png. If `folder` is empty, the
/// image_0 (left, gray) of a KITTI sequence is used. Throws InputError for a missing folder, names
/// that are not numbers, and scans without an image (with the first of them).
Dataset camera_images(const Dataset& dataset, const std::filesystem::path& folder = {});

/// Opens a folder of .png images named by frame numbers, without poses. Throws as camera_images().
Dataset image_folder(const std::filesystem::path& folder);

/// Returns `poses/NN.txt` under the root or `poses.txt` in the sequence. Throws InputError if
/// neither exists.
std::filesystem::path find_kitti_poses(const std::filesystem::path& root,
                                       const std::string& sequence);

}  // namespace revisit
