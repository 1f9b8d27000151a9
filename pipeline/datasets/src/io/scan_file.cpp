#include "revisit/datasets/scan_file.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>

#include "io/point_files.h"
#include "revisit/base/atomic_file.h"
#include "revisit/base/error.h"
#include "revisit/base/file_cursor.h"

namespace revisit::pipeline {
namespace {

namespace fs = std::filesystem;

// KITTI's record is a Point as it lies in memory.
static_assert(sizeof(Point) == 16 && std::endian::native == std::endian::little);

/// A coordinate of a return in the sensor's frame is some metres: bytes that mean something else
/// give numbers that are far larger or smaller.
bool is_absurd(const Point& p) {
  constexpr float kFarthest = 1000, kNearest = 0.001F;  // [m]
  const float largest = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
  return largest > kFarthest || (largest > 0 && largest < kNearest);
}

/// Whatever is named .bin is read as points. Some of them tell whether they are.
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
                   gzip ? "; it starts as gzip files do, unpack it first" : "");
}

void read_kitti_bin(const fs::path& file, PointCloud& cloud) {
  FileCursor in(file);
  if (in.size() == 0) throw InputError(file.string() + ": empty file, it holds no points");
  if (const uint64_t remainder = in.size() % sizeof(Point))
    throw InputError(file.string(), ": ", in.size(), " bytes is not a whole number of points of ",
                     sizeof(Point), " bytes (float32 x y z reflectance): remainder ", remainder,
                     "; the file is truncated or is not a KITTI scan");
  cloud.points.resize(in.size() / sizeof(Point));
  in.read(cloud.points.data(), in.size());
  check_plausible(file, cloud);
}

/// Lower case, so that SCAN.PCD is one too.
std::string extension_of(const fs::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

void read_by_extension(const fs::path& file, PointCloud& cloud) {
  const std::string extension = extension_of(file);
  if (extension == ".bin")
    read_kitti_bin(file, cloud);
  else if (extension == ".pcd")
    cloud = read_pcd(file);
  else if (extension == ".ply")
    cloud = read_ply(file);
  else
    throw InputError(file.string(), ": unknown kind of scan '", extension,
                     "'; expected .bin (KITTI), .pcd or .ply");
}

}  // namespace

bool is_scan_file_name(const fs::path& file) {
  const std::string extension = extension_of(file);
  return extension == ".bin" || extension == ".pcd" || extension == ".ply";
}

void read_scan_into(const fs::path& file, PointCloud& cloud) {
  read_by_extension(file, cloud);
  if (std::none_of(cloud.points.begin(), cloud.points.end(), is_return))
    throw InputError(file.string(), ": none of its ", cloud.points.size(),
                     " points is usable: all are NaN or at the sensor's origin");
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

}  // namespace revisit::pipeline
