#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/range_image.h"

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

/// Time [s] in a name: SEC_NSEC.pcd, SEC.FRACTION.pcd, or 16 digits (microseconds) or 19 digits
/// (nanoseconds). Returns nothing for other names, such as frame numbers.
std::optional<double> time_in_name(const std::filesystem::path& file);

/// Field names of per-point times; the first match counts. A t beside an s is a texture coordinate.
constexpr const char* kPointTimeNames[] = {"t", "time", "timestamp", "offset_time",
                                           "point_time_offset"};

/// Converts per-point times of a recording to seconds from the scan's stamp. Integers are
/// nanoseconds. Floating-point values are seconds, or nanoseconds from 10^14 on. Values of a second
/// or more are absolute: they are relative to `stamp` if it has the same clock, else to the
/// earliest; values of 0 then mark points without a return. Returns nothing for values that cannot
/// be times of one scan: all equal, not finite, or more than a second from the stamp.
std::vector<float> point_times(std::span<const double> values, bool nanoseconds,
                               std::optional<double> stamp = {});

/// Returns T_start_then of a motion with constant linear and angular velocity, `T_before_after` in
/// `seconds`, more than 0. The time [s] may be negative.
std::function<Eigen::Isometry3d(double time)> constant_velocity(
    const Eigen::Isometry3d& T_before_after, double seconds);

/// Moves points to the sensor frame at the scan's stamp, by the cloud's times and the constant
/// velocity `T_before_after` in `seconds`. Nothing moves without times, or if the motion is
/// implausible: no time or more than 2 s between the scans, faster than 60 m/s or 6.3 rad/s.
void deskew(const Eigen::Isometry3d& T_before_after, double seconds, PointCloud& cloud);

/// Upper limit of an image's pixels; computing from an image takes some 200 bytes per pixel.
inline constexpr int64_t kMaxImagePixels = int64_t{4} << 20;

/// Reads any PNG as gray (luminance of sRGB). Throws InputError, also above kMaxImagePixels.
GrayImage read_gray_png(const std::filesystem::path& file);

GrayImage gray_of(const RangeImage& image);  // rounded

/// Throws Error with `what`.
std::string png_of(const GrayImage& image, const std::string& what);

/// Writes atomically. Throws Error on failure.
void write_gray_png(const std::filesystem::path& file, const GrayImage& image);

}  // namespace revisit
