#pragma once

#include <functional>
#include <iosfwd>
#include <optional>

#include "revisit/datasets/dataset.h"

namespace revisit::cli {

/// Returns the next scan, or nothing at the end. Poses are T_world_sensor.
using ScanStream = std::function<std::optional<ScanRef>()>;

/// Scans of a data set with camera poses, converted by the calib.txt beside the scans, or else by
/// the axes of KITTI's camera.
std::vector<ScanRef> with_sensor_poses(Dataset dataset);
ScanStream stream_of(std::vector<ScanRef> scans);

/// Reads one file per line and skips empty lines. Frames count from 0.
ScanStream scans_listed_in(std::istream& list);

/// Scans of a growing data set: those that exist and those that come while it is watched. A file is
/// complete once a later one exists or its size stays the same for a moment. Ends if `stop` returns
/// true or no scan came for `patience` seconds. An InputError of `so_far` is then thrown if no scan
/// ever came, else printed as a warning.
ScanStream scans_coming(const std::function<Dataset()>& so_far, double patience,
                        const std::function<bool()>& stop);

}  // namespace revisit::cli
