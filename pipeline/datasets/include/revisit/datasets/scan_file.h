#pragma once

#include <filesystem>
#include <optional>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// Reads `.bin` (KITTI, float32 x y z reflectance; other files of 3 to 6 float32 or float64 a point
/// that begin with x y z are told by their content), `.pcd` or `.ply` (any fields with x, y, z;
/// intensity when there). Throws InputError, naming the file, when it is missing, truncated,
/// malformed, or has no finite point but the origin. The file's size bounds what is allocated.
PointCloud read_scan(const std::filesystem::path& file);

/// The same, into a cloud whose memory is used again.
void read_scan_into(const std::filesystem::path& file, PointCloud& cloud);

/// True for the extensions read_scan() knows, in any case.
bool is_scan_file_name(const std::filesystem::path& file);

/// Writes KITTI's .bin, atomically. Throws Error when it cannot.
void write_kitti_scan(const std::filesystem::path& file, const PointCloud& cloud);

/// Writes PCD, binary, with the cloud's times as the field `time`, atomically. Its header has
/// kPcdHeaderBytes, a point kPcdPointBytes. Throws Error when it cannot.
void write_pcd_scan(const std::filesystem::path& file, const PointCloud& cloud);
constexpr size_t kPcdHeaderBytes = 166, kPcdPointBytes = sizeof(Point) + sizeof(float);

/// The time [s] that a file's name is: SEC_NSEC.pcd, SEC.FRACTION.pcd, or 16 digits of micro- or 19
/// of nanoseconds. Nothing for other names, such as numbers of frames.
std::optional<double> time_in_name(const std::filesystem::path& file);

}  // namespace revisit::pipeline
