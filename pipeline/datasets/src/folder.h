#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// A file and its place in the drive.
struct NumberedFile {
  int frame = 0;
  std::filesystem::path file;
  std::optional<double> time = {};  // [s], that the names of all have: time_in_name()
};

enum class FrameNumbers {
  kFromNames,         // every name must be a number (KITTI: poses are looked up by it)
  kFromNamesOrOrder,  // otherwise 0, 1, 2... in order of their times, else natural order
};

/// Visible scan files by frame. Throws InputError for no folder, no scan, or a frame named twice.
std::vector<NumberedFile> list_scans(const std::filesystem::path& folder, FrameNumbers numbers);

/// The same for .png images, whose names must be numbers.
std::vector<NumberedFile> list_images(const std::filesystem::path& folder);

/// True when something in the folder passes `wanted`; nothing is looked at after the first.
bool holds(const std::filesystem::path& folder, bool (*wanted)(const std::filesystem::path&));
bool holds_scans(const std::filesystem::path& folder);

/// The end of a message about compressed scans; "" when the folder has none.
std::string compressed_scans(const std::filesystem::path& folder);

/// Names that pass `keep`, in natural order ("scan2" before "scan10"); none without the folder.
std::vector<std::string> list_names(const std::filesystem::path& folder,
                                    bool (*keep)(const std::filesystem::path&));

}  // namespace revisit::pipeline
