#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::pipeline {

struct PlaceFolders {
  std::string name, sequence;                 // as in Dataset
  std::vector<std::filesystem::path> places;  // one folder per place; may be empty
};

/// Finds folders of scans in `root`, in its set `sequence`, or in its only set. Throws InputError
/// if ambiguous.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit::pipeline
