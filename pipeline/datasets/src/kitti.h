#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace revisit {

struct KittiSequence {
  std::string name;              // name of the root folder
  std::string sequence;          // "00"; "" for a lone folder that is not the NN of a root
  std::filesystem::path folder;  // holds velodyne/, calib.txt, times.txt
  std::vector<std::filesystem::path> pose_files;  // paths to search, in order

  std::filesystem::path velodyne() const { return folder / "velodyne"; }
  std::optional<std::filesystem::path> poses() const;
};

/// Finds a sequence in a root (with `sequences/` or `poses/`) or in a sequence's folder that has
/// poses (`for_poses`) or scans; returns nothing for other folders. Throws InputError for a missing
/// folder, and with a list of sequences if none or several match.
std::optional<KittiSequence> find_kitti_sequence(const std::filesystem::path& root,
                                                 const std::string& sequence, bool for_poses);

}  // namespace revisit
