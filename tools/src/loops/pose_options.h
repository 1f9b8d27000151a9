#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "cli/options.h"
#include "revisit/datasets/dataset.h"

namespace revisit::cli {

struct PoseOptions {
  std::filesystem::path file, calib;
  std::optional<bool> of_camera;
  double max_gap = 0.1;

  void declare(Options& options);
  /// Scans with T_world_sensor in a world with KITTI's axes, from the file or else the data set.
  std::vector<ScanRef> scans_of(const Dataset& dataset) const;
  /// A pose of scans_of() in the axes of the file, or of KITTI.
  Pose as_given(const Pose& pose) const { return in_frame(pose, of_camera.value_or(true)); }
  std::optional<Pose> as_given(const std::optional<Pose>& pose) const {
    return pose ? std::optional(as_given(*pose)) : std::nullopt;
  }
};

}  // namespace revisit::cli
