#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <vector>

#include "cli/options.h"
#include "eval/feature_options.h"
#include "revisit/datasets/dataset.h"

namespace revisit::cli {

/// Returns the next scan, or nothing at the end. Poses are T_world_sensor.
using ScanStream = std::function<std::optional<ScanRef>()>;

/// Scans with T_world_sensor: poses of KITTI's camera are converted by the calib.txt beside the
/// scans, or else by the camera's axes.
std::vector<ScanRef> with_sensor_poses(Dataset dataset);
ScanStream stream_of(std::vector<ScanRef> scans);
/// `first`, then `rest`.
ScanStream chained(std::vector<ScanRef> first, ScanStream rest);

constexpr size_t kShowSensor = 3;  // scans that show the sensor

struct PoseOptions {
  std::filesystem::path file, calib;
  std::optional<bool> of_camera;
  double max_gap = 0.1;

  void declare(Options& options);
  /// Scans with T_world_sensor, from the file or else the data set.
  std::vector<ScanRef> scans_of(const Dataset& dataset) const;
};

struct ScanSource {
  ScanStream next;
  Dataset some;       // with scans that show the sensor
  int64_t count = 0;  // of all scans; 0: unknown
};

/// Opens a data set, a recording, a folder that grows if `follow` has the longest time [s] between
/// two scans, or standard input for "-": scans in the format of docs/reference/FORMATS.md, or names
/// of files. `next` throws InputError if a recording is truncated, and Interrupted.
ScanSource open_source(const FeatureOptions& data, const PoseOptions& poses,
                       std::optional<double> follow);

}  // namespace revisit::cli
