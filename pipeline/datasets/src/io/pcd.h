#pragma once

#include <filesystem>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// Reads a Point Cloud Data file (PCL's format, version 0.6 and 0.7: ascii, binary,
/// binary_compressed). Throws InputError.
///
/// The reader is ours, but for the decompression: PCL 1.13's takes "abc" and half a line for points
/// and sizes its buffers by the header before it looks at the file.
PointCloud read_pcd(const std::filesystem::path& file);

}  // namespace revisit::pipeline
