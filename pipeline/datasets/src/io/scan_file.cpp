#include "revisit/datasets/scan_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "io/point_files.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/datasets/dataset.h"

namespace revisit {
namespace {

namespace fs = std::filesystem;

// KITTI's record has the memory layout of Point.
static_assert(sizeof(Point) == 16 && std::endian::native == std::endian::little);

/// Coordinates of a return are some meters; misinterpreted bytes give far larger or smaller values.
bool is_absurd(const Point& p) {
  constexpr float kMaxRange = 1000, kNearest = 0.001F;  // [m]
  const float largest = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
  return largest > kMaxRange || (largest > 0 && largest < kNearest);
}

/// Rejects implausible points, because a .bin file has no header.
void check_plausible(const fs::path& file, const PointCloud& cloud) {
  constexpr size_t kLookedAt = 1000;
  const size_t step = std::max<size_t>(1, cloud.points.size() / kLookedAt);
  size_t returns = 0, absurd = 0;
  for (size_t i = 0; i < cloud.points.size(); i += step) {
    if (!is_return(cloud.points[i])) continue;
    ++returns;
    absurd += is_absurd(cloud.points[i]) ? 1 : 0;
  }
  if (2 * absurd <= returns) return;
  const auto* bytes = reinterpret_cast<const unsigned char*>(cloud.points.data());
  const bool gzip = bytes[0] == 0x1f && bytes[1] == 0x8b;
  throw InputError(file.string(),
                   ": most of its points are farther than 1 km or nearer than 1 mm: this is "
                   "not a scan of float32 x y z reflectance in the sensor's frame",
                   gzip ? "; it is a gzip file, unpack it first" : "");
}

void take_points(const std::vector<std::byte>& content, const BinLayout& layout,
                 PointCloud& cloud) {
  cloud.points.clear();
  for (size_t at = 0; at < content.size(); at += layout.bytes()) {
    std::array<float, 4> values{};
    for (size_t i = 0; i < std::min(layout.numbers, values.size()); ++i)
      values[i] = static_cast<float>(number_at(content, layout, at / layout.bytes(), i));
    cloud.points.push_back({values[0], values[1], values[2], values[3]});
  }
}

void read_bin(const fs::path& file, PointCloud& cloud) {
  FileCursor in(file);
  const uint64_t size = in.size();
  if (size == 0) throw InputError(file.string() + ": empty file, it holds no points");
  cloud.points.resize((size + sizeof(Point) - 1) / sizeof(Point));
  in.read(cloud.points.data(), size);
  cloud.times.clear();
  const auto content = std::as_bytes(std::span(cloud.points)).first(size);
  const BinLayout layout = find_bin_layout(content);
  if (const uint64_t remainder = size % layout.bytes())
    throw InputError(file.string(), ": ", size, " bytes is not a whole number of points of ",
                     layout.bytes(), " bytes (float32 x y z reflectance): remainder ", remainder,
                     "; the file is truncated or is not a KITTI scan");
  if (layout.doubles || layout.numbers != 4)
    take_points({content.begin(), content.end()}, layout, cloud);
  check_plausible(file, cloud);
}

std::string lower_case_extension_of(const fs::path& file) {
  return lower(file.extension().string());
}

void read_by_extension(const fs::path& file, PointCloud& cloud, RecordedTimes& times) {
  const std::string extension = lower_case_extension_of(file);
  if (extension == ".bin") return read_bin(file, cloud);
  if (extension == ".pcd")
    cloud = read_pcd(file, times);
  else if (extension == ".ply")
    cloud = read_ply(file, times);
  else
    throw InputError(FileCursor(file).file().string(), ": unknown kind of scan '", extension,
                     "'; expected .bin (KITTI), .pcd or .ply");
}

void check_any_return(const fs::path& file, const PointCloud& cloud) {
  if (std::none_of(cloud.points.begin(), cloud.points.end(), is_return))
    throw InputError(file.string(), ": none of its ", cloud.points.size(),
                     " points is usable: all are NaN or at the sensor's origin");
}

}  // namespace

bool is_scan_file_name(const fs::path& file) {
  const std::string extension = lower_case_extension_of(file);
  return extension == ".bin" || extension == ".pcd" || extension == ".ply";
}

RecordedTimes read_recorded_scan(const fs::path& file, PointCloud& cloud) {
  RecordedTimes times;
  read_by_extension(file, cloud, times);
  check_any_return(file, cloud);
  return times;
}

void read_scan_into(const fs::path& file, PointCloud& cloud) {
  const RecordedTimes times = read_recorded_scan(file, cloud);
  set_times(times, point_times_of({&times, 1}), cloud);
}

void read_scan_into(const ScanRef& scan, PointCloud& cloud) {
  if (!scan.read) {
    if (!scan.point_times) return read_scan_into(scan.file, cloud);
    RecordedTimes times = read_recorded_scan(scan.file, cloud);
    times.stamp = scan.time;
    return set_times(times, *scan.point_times, cloud);
  }
  scan.read(cloud);
  check_any_return(scan.file, cloud);
}

void find_point_times(Dataset& dataset, const std::string& unit) {
  constexpr size_t kStamps = 20, kRead = 4;
  std::vector<RecordedTimes> recorded;
  PointCloud cloud;
  size_t read = 0;
  for (const ScanRef& scan :
       std::span(dataset.scans).first(std::min(dataset.scans.size(), kStamps))) {
    RecordedTimes times;
    if (!scan.read && read < kRead) try {
        times = read_recorded_scan(scan.file, cloud);
        ++read;
      } catch (const InputError&) {  // reported when the scan is read again
      }
    times.stamp = scan.time;
    recorded.push_back(std::move(times));
  }
  if (std::ranges::all_of(recorded, &std::string::empty, &RecordedTimes::field)) return;
  const PointTimes found = point_times_of(recorded, unit);
  dataset.point_times = found.text;
  for (ScanRef& scan : dataset.scans) scan.point_times = found;
}

PointCloud read_scan(const ScanRef& scan) {
  PointCloud cloud;
  read_scan_into(scan, cloud);
  return cloud;
}

PointCloud read_scan(const fs::path& file) {
  PointCloud cloud;
  read_scan_into(file, cloud);
  return cloud;
}

void write_kitti_scan(const fs::path& file, const PointCloud& cloud) {
  write_atomically(file, [&](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(cloud.points.data()),
              static_cast<std::streamsize>(cloud.points.size() * sizeof(Point)));
  });
}

}  // namespace revisit
