#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/pose.h"

namespace revisit::pipeline {

/// One scan of a data set, by reference: the points are read when they are needed.
struct ScanRef {
  std::filesystem::path file;
  int frame = 0;             // index in the drive; KITTI: the number in the file name (gaps legal)
  std::optional<Pose> pose;  // T_world_cam for KITTI, as stored; absent without ground truth
  std::optional<double> time;  // [s]
  std::string place;           // in a data set sorted by places: which; else ""
};

/// A drive, or any folder of scans, in frame order.
struct Dataset {
  std::string name;      // e.g. "kitti"
  std::string sequence;  // e.g. "00"; "" for a plain folder
  std::vector<ScanRef> scans;
  /// Of the whole drive, one a frame, also where scans are missing or left out; 0 without poses.
  int64_t n_poses = 0;
  std::vector<std::string> warnings;  // for the user: what looks wrong but can be used
  bool has_poses() const {
    for (const ScanRef& scan : scans)
      if (!scan.pose) return false;
    return !scans.empty();
  }
  /// The places are known by name: scans of one name are of one place.
  bool has_places() const { return !scans.empty() && !scans[0].place.empty(); }
};

struct DatasetNeeds {
  bool poses = false;
};

/// Opens a KITTI odometry sequence, a folder per place, or a plain folder of .bin/.pcd/.ply files.
///
/// `root` may be
/// - the KITTI root (`sequences/NN/velodyne`, `poses/NN.txt`; needs `sequence` unless exactly one
///   sequence has scans) or one sequence folder (`velodyne/`, `poses.txt` or `../../poses/NN.txt`);
/// - a set of places, as the HKUST data can be sorted: a folder of scan files per place
///   (`place_1/*.bin`, `library/*.pcd`...), without poses. Frames are counted from 0 through all
///   places, in natural order of the names. `sequence` names one of several such sets;
/// - a folder of scan files (no poses).
/// Throws InputError saying what was looked for and where, and which sequences are there.
Dataset open_dataset(const std::filesystem::path& root, const std::string& sequence,
                     const DatasetNeeds& needs = {});

/// The data set with the image of each frame, e.g. 000123.png, as its file. `folder` may be empty
/// for a KITTI sequence: its image_0 (left, gray) is taken. Throws InputError for a missing folder,
/// names that are not numbers, and scans without an image, naming the first of them.
Dataset camera_images(const Dataset& dataset, const std::filesystem::path& folder = {});

/// A folder of .png images named by frame numbers, without poses. Throws as camera_images().
Dataset image_folder(const std::filesystem::path& folder);

/// `poses/NN.txt` under the root or `poses.txt` in the sequence; else InputError with both places.
std::filesystem::path find_kitti_poses(const std::filesystem::path& root,
                                       const std::string& sequence);

}  // namespace revisit::pipeline
