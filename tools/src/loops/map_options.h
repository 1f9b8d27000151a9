#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cli/options.h"
#include "loops/open_recognizer.h"

namespace revisit::cli {

struct MapOptions {
  std::filesystem::path file, projection;
  std::string drive;
  int64_t warmup = RecognizerOptions().warmup;
  DescriptorType dtype = DescriptorType::kFloat32;
  bool no_clouds = false;

  void declare(Options& options);
  /// Creates a missing map. Returns null without a file.
  std::unique_ptr<MapStore> open(const RecognizerSource& source) const;
  std::string drive_of(const Dataset& dataset) const {
    return !drive.empty() ? drive : !dataset.sequence.empty() ? dataset.sequence : dataset.name;
  }
};

/// Removes a new map without entries if the command fails, because an empty map would bind later
/// commands to its sensor. Must outlive the map.
class NewMap {
 public:
  explicit NewMap(const std::filesystem::path& map);
  ~NewMap();
  NewMap(const NewMap&) = delete;
  NewMap& operator=(const NewMap&) = delete;

 private:
  std::filesystem::path file_;  // "": the map existed
  int exceptions_;              // in flight at construction
};

}  // namespace revisit::cli
