#pragma once

#include <filesystem>

#include "revisit/recognition/point_cloud.h"

// These readers replace PCL's (1.13), which accept garbage and size their buffers by unchecked
// headers. Only LZF is a library.
namespace revisit {

/// Reads PCL's Point Cloud Data 0.6 and 0.7: ascii, binary, binary_compressed. Throws InputError.
PointCloud read_pcd(const std::filesystem::path& file);

/// Reads the vertices of a Stanford PLY 1.0: ascii, binary of either byte order. Throws InputError.
PointCloud read_ply(const std::filesystem::path& file);

}  // namespace revisit
