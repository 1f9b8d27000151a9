#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::pipeline {

struct PlaceFolders {
  std::string name, sequence;                 // as Dataset's
  std::vector<std::filesystem::path> places;  // each holds the scans of one place; may be none
};

/// Finds the folders of scans in `root`, or in the set of such folders that `sequence` names, or
/// the only one. Throws InputError when several sets are there and none is named, or another one.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit::pipeline
