#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// Where the parts of one KITTI sequence are, or would be.
struct KittiSequence {
  std::string name;              // of the data set: its root folder's name
  std::string sequence;          // "00"; "" for a lone folder that is not the NN of a root
  std::filesystem::path folder;  // holds velodyne/, calib.txt, times.txt
  std::vector<std::filesystem::path> pose_files;  // the places to look, in order

  std::filesystem::path velodyne() const { return folder / "velodyne"; }
  /// The first place that is there.
  std::optional<std::filesystem::path> poses() const;
};

/// Resolves a root (with `sequences/` or `poses/`) or one sequence's folder; nothing when it is
/// neither. Throws InputError when `root` is not a folder, and when `sequence` is empty or not
/// there so that none, or more than one, sequence could be meant; the message lists those that are.
/// `for_poses`: a sequence is there when its poses are; otherwise when its scans are.
std::optional<KittiSequence> find_kitti_sequence(const std::filesystem::path& root,
                                                 const std::string& sequence, bool for_poses);

}  // namespace revisit::pipeline
