#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit::pipeline {

struct PlaceFolders {
  std::string name, sequence;                 // as Dataset's
  std::vector<std::filesystem::path> places;  // each holds the scans of one place; may be none
};

/// Folders of scans in `root`, or in its set `sequence`, or its only set; InputError if unclear.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit::pipeline
