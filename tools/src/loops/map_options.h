#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cli/parser.h"
#include "loops/open_recognizer.h"

namespace revisit::cli {

/// What every command that adds places to a map takes.
struct MapOptions {
  std::filesystem::path file, basis;
  std::string drive;
  int64_t first_stretch = pipeline::RecognizerOptions().first_stretch;
  pipeline::NumberFormat numbers = pipeline::NumberFormat::kFloat32;
  bool no_clouds = false;

  void declare(Parser& parser);
  /// Throws UsageError.
  void check() const;
  /// The map, made when it is missing; null without a file.
  std::unique_ptr<pipeline::MapStore> open(const RecognizerSource& source) const;
  /// What the drive is called in the map.
  std::string drive_of(const pipeline::Dataset& dataset) const {
    return !drive.empty() ? drive : !dataset.sequence.empty() ? dataset.sequence : dataset.name;
  }
};

/// Removes the file of a map that a command made before it failed without a place. Else the map
/// would bind later commands to this one's sensor. Is to outlive the map.
class NewMap {
 public:
  explicit NewMap(const std::filesystem::path& map);
  ~NewMap();
  NewMap(const NewMap&) = delete;
  NewMap& operator=(const NewMap&) = delete;

 private:
  std::filesystem::path file_;  // "": there was a map
  int exceptions_;              // in flight before
};

}  // namespace revisit::cli
