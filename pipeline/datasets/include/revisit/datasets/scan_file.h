#pragma once

#include <filesystem>
#include <optional>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Reads `.bin`, `.pcd` or `.ply`. A `.bin` has float32 x y z reflectance (KITTI), or 3 to 6
/// float32 or float64 values per point that begin with x y z, detected by content. The others may
/// have any fields with x, y, z; intensity is read if present. Throws InputError with the file if
/// it is missing, truncated, malformed, or has no finite point except the origin. Memory is bounded
/// by the file's size.
PointCloud read_scan(const std::filesystem::path& file);

/// Reuses the memory of `cloud`.
void read_scan_into(const std::filesystem::path& file, PointCloud& cloud);

/// Case-insensitive.
bool is_scan_file_name(const std::filesystem::path& file);

/// Writes KITTI's .bin atomically. Throws Error on failure.
void write_kitti_scan(const std::filesystem::path& file, const PointCloud& cloud);

/// Writes binary PCD atomically, with `cloud.times`, one per point, as the field `time`. The header
/// has kPcdHeaderBytes, a point kPcdPointBytes. Throws Error on failure, UsageError unless each
/// point has a time.
void write_pcd_scan(const std::filesystem::path& file, const PointCloud& cloud);
constexpr size_t kPcdHeaderBytes = 166, kPcdPointBytes = sizeof(Point) + sizeof(float);

/// Time [s] in a name: SEC_NSEC.pcd, SEC.FRACTION.pcd, or 16 digits (microseconds) or 19 digits
/// (nanoseconds). Returns nothing for other names, such as frame numbers.
std::optional<double> time_in_name(const std::filesystem::path& file);

}  // namespace revisit
