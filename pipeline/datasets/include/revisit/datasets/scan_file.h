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

/// Frame number: a name of digits only. Returns nothing for others, and for time stamps in
/// nanoseconds.
std::optional<int> number_in_name(const std::filesystem::path& file);

/// Time [s] in a name: SEC_NSEC.pcd, SEC.FRACTION.pcd, or 16 digits (microseconds) or 19 digits
/// (nanoseconds). Returns nothing for other names, such as frame numbers.
std::optional<double> time_in_name(const std::filesystem::path& file);

/// Field names of per-point times; the first match counts. A t beside an s is a texture coordinate,
/// timestampSec needs timestampNsec.
constexpr const char* kPointTimeNames[] = {
    "t",           "time",        "timestamp",         "time_stamp",
    "offset_time", "time_offset", "point_time_offset", "timestampSec",
    "curvature"};

/// Times of a scan's points as recorded. timestampSec and timestampNsec are nanoseconds together.
struct RecordedTimes {
  std::string field;            ///< name; "" without times
  std::vector<double> values;   ///< [points]
  std::optional<double> stamp;  ///< of the scan [s]
};

/// Convention of per-point times, the same for all scans of a recording.
struct PointTimes {
  double unit = 0;        ///< of a value [s]; 0: no times
  double period = 0.1;    ///< of the scans [s]
  bool of_clock = false;  ///< values count from a clock's origin; else from the scan's stamp
  /// The clock of the values minus that of the stamps [s]: 0, or TAI's or GPS's; NaN: unrelated
  /// clocks, so that times count from the earliest point.
  double ahead = 0;
  std::string text;  ///< for messages: "field t, ns"; or the reason why there are no times

  /// Seconds from the stamp. NaN: this value is invalid, e.g. 0 for a lost packet. Empty if the
  /// values cannot be times of one scan.
  std::vector<float> of(std::span<const double> values, std::optional<double> stamp) const;
};

/// Decides the convention from some scans in order, by the range of values and the distance of
/// stamps. `unit`: auto, s, ms, us, ns, scan (0 to 1) or none. `period` [s]: absent: from the
/// stamps; unknown with a single scan. Float fractions of a scan last 0.1 s if the period is
/// unknown or longer than a revolution. Throws UsageError for another unit.
PointTimes point_times_of(std::span<const RecordedTimes> scans, const std::string& unit = "auto",
                          std::optional<double> period = {});

/// Reads a scan and its times as recorded; `cloud.times` are empty.
RecordedTimes read_recorded_scan(const std::filesystem::path& file, PointCloud& cloud);

/// Sets the times of a cloud and removes points with invalid times.
void set_times(const RecordedTimes& times, const PointTimes& convention, PointCloud& cloud);

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

GrayImage gray_of(const RangeImage& image);  ///< rounded

/// Throws Error with `what`.
std::string png_of(const GrayImage& image, const std::string& what);

/// Writes atomically. Throws Error on failure.
void write_gray_png(const std::filesystem::path& file, const GrayImage& image);

}  // namespace revisit
