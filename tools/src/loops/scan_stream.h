#pragma once

#include <filesystem>
#include <functional>
#include <iosfwd>
#include <optional>

#include "revisit/datasets/dataset.h"

namespace revisit::cli {

/// Gives one scan after another, as they come; nothing at the end. Poses are T_world_sensor.
using ScanStream = std::function<std::optional<pipeline::ScanRef>()>;

/// The scans of a data set, whose poses are the camera's: with the calib.txt beside the scans, or
/// the axes of KITTI's camera where there is none.
std::vector<pipeline::ScanRef> with_sensor_poses(pipeline::Dataset dataset);
ScanStream scans_of(pipeline::Dataset dataset);

/// A file a line: "scan.bin". Frames are counted from 0. Empty lines are passed over.
ScanStream scans_listed_in(std::istream& list);

/// The scan files of a folder in the order of their names, and those that come while it is watched;
/// a file counts when a later one is there, or when it has not grown for a moment. Ends when `stop`
/// says so, or when nothing came for `patience` seconds.
ScanStream scans_coming_to(const std::filesystem::path& folder, double patience,
                           const std::function<bool()>& stop);

}  // namespace revisit::cli
