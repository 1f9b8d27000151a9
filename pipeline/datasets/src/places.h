#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace revisit {

struct PlaceFolders {
  std::string name, sequence;
  std::vector<std::filesystem::path> places;  // may be empty
};

/// Searches `root`, its set `sequence`, or its only set. Throws InputError if ambiguous.
PlaceFolders find_places(const std::filesystem::path& root, const std::string& sequence);

}  // namespace revisit
