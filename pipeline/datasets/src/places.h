#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::pipeline {

/// The folders of a data set that is sorted by places.
struct PlaceFolders {
  std::string name, sequence;                 // as Dataset's
  std::vector<std::filesystem::path> places;  // each holds the scans of one place; may be none
};

/// Finds the folders of scans in `root`, or in one of its folders: a set of such folders, named by
/// `sequence`, or the only one there. Throws InputError when there are several sets and none is
/// named, or when there are sets but not the one that is named.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit::pipeline
