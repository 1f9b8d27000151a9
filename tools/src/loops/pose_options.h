#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "cli/parser.h"
#include "revisit/datasets/timed_poses.h"

namespace revisit::cli {

struct PoseOptions {
  std::filesystem::path file, calib;
  std::optional<pipeline::PoseFormat> format;
  std::optional<pipeline::PoseFrame> frame;
  double max_gap = 0.1;

  void declare(Parser& parser);
  /// Throws UsageError.
  void check(const Parser& parser) const;
  /// Scans with T_world_sensor in a world with KITTI's axes, from the file or else the data set.
  std::vector<pipeline::ScanRef> scans_of(const pipeline::Dataset& dataset) const;
  /// A pose of scans_of() in the axes of the file, or of KITTI.
  pipeline::Pose as_given(const pipeline::Pose& pose) const {
    return pipeline::in_frame(pose, frame.value_or(pipeline::PoseFrame::kCamera));
  }
  std::optional<pipeline::Pose> as_given(const std::optional<pipeline::Pose>& pose) const {
    return pose ? std::optional(as_given(*pose)) : std::nullopt;
  }
};

}  // namespace revisit::cli
