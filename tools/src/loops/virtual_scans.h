#pragma once

#include <filesystem>

#include "eval/feature_options.h"
#include "revisit/datasets/dataset.h"

namespace revisit::cli {

/// Scans that the sensor `geometry` of `beams` would take in a cloud of a site with z up (.pcd,
/// .ply, .las, .laz). Poses are T_world_sensor in the frame of the cloud. They are those of
/// `trajectory`, at least 2 m apart, or if it is "" stand upright on the floor that is free, on a
/// grid. Points are rendered when a scan is read. Throws InputError if the cloud has no free floor.
Dataset virtual_scans(const FeatureOptions& options, const std::filesystem::path& trajectory);

}  // namespace revisit::cli
