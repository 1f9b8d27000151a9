#pragma once

#include <filesystem>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// Reads the vertices of a Polygon File Format file (Stanford PLY 1.0: ascii, binary of either byte
/// order). Throws InputError. Ours, because PCL 1.13's reader reports success for a file whose
/// numbers do not parse.
PointCloud read_ply(const std::filesystem::path& file);

}  // namespace revisit::pipeline
