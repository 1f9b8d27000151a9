#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

struct KittiSequence {
  std::string name;              // of the data set: its root folder's name
  std::string sequence;          // "00"; "" for a lone folder that is not the NN of a root
  std::filesystem::path folder;  // holds velodyne/, calib.txt, times.txt
  std::vector<std::filesystem::path> pose_files;  // the places to look, in order

  std::filesystem::path velodyne() const { return folder / "velodyne"; }
  /// The first place that is there.
  std::optional<std::filesystem::path> poses() const;
};

/// Resolves a root (with `sequences/` or `poses/`) or a sequence's folder with poses (`for_poses`)
/// or scans, else nothing. Throws InputError for no folder or, with a list, not one sequence.
std::optional<KittiSequence> find_kitti_sequence(const std::filesystem::path& root,
                                                 const std::string& sequence, bool for_poses);

}  // namespace revisit::pipeline
