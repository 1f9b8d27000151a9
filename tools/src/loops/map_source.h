#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "cli/options.h"
#include "eval/feature_options.h"
#include "revisit/maps/map.h"

namespace revisit::cli {

struct MapSource : FeatureSource {
  MapOptions options;
};
/// kOne: all cores work on one scan; kMany: each on its own.
enum class ScansAtOnce { kOne, kMany };
/// `map_key`: feature_key_of() the map, "" of a new one. A PCA comes from a folder (--fit-on DIR),
/// or is estimated from the first `warmup` distinct map entries. An estimated PCA is not kept in
/// maps, and all descriptors before it are zero. Throws UsageError for a feature that needs all
/// scans of a drive.
MapSource map_source(FeatureOptions& options, const Dataset& some, const std::string& map_key,
                     ScansAtOnce at_once = ScansAtOnce::kOne,
                     std::optional<int64_t> warmup = std::nullopt);

struct MapArguments {
  std::filesystem::path file, projection;
  std::string drive;
  int64_t warmup = MapOptions().warmup;
  std::optional<DescriptorType> dtype;  // only of a new map, or the map's
  bool no_clouds = false;

  void declare(Options& options);
  /// Creates a missing map. Returns null without a file. Throws InputError if the map has another
  /// dtype or projection than given.
  std::unique_ptr<MapStore> open(const MapSource& source) const;
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
