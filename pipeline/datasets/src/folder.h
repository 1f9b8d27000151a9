#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace revisit {

struct NumberedFile {
  int frame = 0;
  std::filesystem::path file;
  std::optional<double> time = {};  // [s], time_in_name() if all names have one
};

enum class FrameNumbers {
  kFromNames,         // every name must be a number (KITTI: index of its pose)
  kFromNamesOrOrder,  // otherwise 0, 1, 2... by time, else in natural order
};

/// Visible files by frame. Throws InputError for a missing folder, no scans, or a repeated frame.
std::vector<NumberedFile> list_scans(const std::filesystem::path& folder, FrameNumbers numbers);

/// Names of .png images must be numbers.
std::vector<NumberedFile> list_images(const std::filesystem::path& folder);

bool holds(const std::filesystem::path& folder, bool (*wanted)(const std::filesystem::path&));
bool holds_scans(const std::filesystem::path& folder);

/// Returns the end of a message about compressed scans; "" if the folder has none.
std::string compressed_scans(const std::filesystem::path& folder);

/// Natural order ("scan2" before "scan10"); empty if there is no folder.
std::vector<std::string> list_names(const std::filesystem::path& folder,
                                    bool (*keep)(const std::filesystem::path&));

struct KittiSequence {
  std::string name;              // name of the root folder
  std::string sequence;          // "00"; "" for a lone folder that is not the NN of a root
  std::filesystem::path folder;  // holds velodyne/, calib.txt, times.txt
  std::vector<std::filesystem::path> pose_files;  // paths to search, in order

  std::filesystem::path velodyne() const { return folder / "velodyne"; }
  std::optional<std::filesystem::path> poses() const;
};

/// Finds a sequence with scans in a root (with `sequences/`), or `root` is a sequence's folder;
/// returns nothing for other folders. Throws InputError for a missing folder, and with a list of
/// sequences if none or several match.
std::optional<KittiSequence> find_kitti_sequence(const std::filesystem::path& root,
                                                 const std::string& sequence);

struct PlaceFolders {
  std::string name, sequence;
  std::vector<std::filesystem::path> places;  // may be empty
};

/// Searches `root`, its set `sequence`, or its only set. Throws InputError if ambiguous.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit
