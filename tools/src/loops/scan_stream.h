#pragma once

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
ScanStream stream_of(std::vector<pipeline::ScanRef> scans);

/// A file a line: "scan.bin". Frames are counted from 0. Empty lines are passed over.
ScanStream scans_listed_in(std::istream& list);

/// The scans of a data set that grows: those that are there `so_far`, and those that come while it
/// is watched; a file counts when a later one is there, or when it has not grown for a moment. Ends
/// when `stop` says so, or when nothing came for `patience` seconds. An InputError of `so_far` is
/// then thrown when no scan has ever come, else said.
ScanStream scans_coming(const std::function<pipeline::Dataset()>& so_far, double patience,
                        const std::function<bool()>& stop);

}  // namespace revisit::cli
