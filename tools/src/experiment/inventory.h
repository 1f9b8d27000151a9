#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "models/find_model.h"
#include "revisit/recognition/range_image.h"

namespace revisit::cli {

/// What `revisit experiment` is told.
struct ExperimentOptions {
  std::vector<std::string> names;
  std::filesystem::path kitti, output;
  std::vector<std::filesystem::path> models;
  std::optional<std::filesystem::path> hkust;
  std::string sensor = "hdl64";
  int every = 1, width = 0, threads = 0;
  double feature_mb = 8;  // of one scan; larger features are left out
  bool untrained = false, keep_features = false, no_report = false, no_progress = false,
       quiet = false;
};

/// A drive of the data set that the paper has tasks for.
struct DriveFound {
  std::string sequence;
  int64_t scans = 0;
};

/// A network and the layers to take features from, best first.
struct NetworkFound {
  std::string name;
  std::filesystem::path prototxt, weights;
  bool trained = true;
  std::vector<models::Cut> cuts;
};

/// What there is to experiment with.
struct Inventory {
  std::vector<DriveFound> drives;
  std::vector<NetworkFound> networks;  // trained ones first, in the order of the known models
  /// Of the drives, those that `revisit simulate` wrote: along given poses, along routes of its
  /// own.
  int along_poses = 0, along_routes = 0;
  std::vector<std::string> missing;      // what is not there, and how to get it
  std::vector<std::string> passed_over;  // models that are not networks for range images

  const DriveFound* drive(const std::string& sequence) const;
};

/// Looks for the paper's sequences and for networks. Throws InputError when there is neither a
/// sequence nor a set of places, UsageError for folders that do not exist.
Inventory take_inventory(const ExperimentOptions& options);

}  // namespace revisit::cli
