#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <new>
#include <vector>

#include "prepared_scan.h"
#include "revisit/base/error.h"
#include "revisit/registration/registration.h"

// Format: mount, 12 float64 [3][4]; number of points; then deflated planes, a byte per point each:
// differences of the cells of 16 steps of consecutive points, for x, y and z, then the steps within
// the cells. Points are sorted by cells.
namespace revisit {
namespace {

constexpr double kVoxel = 0.4, kRange = 60;  // [m]; the voxel of scans with few points
constexpr size_t kMaxPoints = 12'000;        // 24 kB; of more points, the voxels are larger
constexpr float kStepsPerMeter = 32;
constexpr int kOffset = 2048;  // [steps], so that coordinates are positive: 12 bits
static_assert(kRange * kStepsPerMeter < kOffset);
constexpr float Point::*kAxes[] = {&Point::x, &Point::y, &Point::z};

using MountNumbers = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
constexpr size_t kMountBytes = sizeof(MountNumbers), kHeadBytes = kMountBytes + sizeof(uint32_t);

constexpr size_t kPlanes = 6;
constexpr double kLargestMount = 1e9;  // [m]; a damaged one would reach poses

/// Of each point a byte per plane, the first one in the highest byte. Sorted.
std::vector<uint64_t> sorted_keys(const PointCloud& cloud, double voxel) {
  std::vector<Eigen::Vector3f> points = thinned(cloud, voxel, kRange);
  int unit = 1;  // coordinates are rounded to multiples of it [steps]
  for (; points.size() > kMaxPoints; unit = 2) {
    voxel *= std::sqrt(1.05 * static_cast<double>(points.size()) / kMaxPoints);  // of surfaces
    points = thinned(cloud, voxel, kRange);
  }
  const float per_meter = kStepsPerMeter / static_cast<float>(unit);
  std::vector<uint64_t> keys;
  for (const Eigen::Vector3f& point : points) {
    uint64_t cells = 0, steps = 0;
    for (const float x : point) {
      const int64_t step = unit * std::lround(x * per_meter) + kOffset;
      cells = cells << 8 | static_cast<uint64_t>(step >> 4);
      steps = steps << 8 | static_cast<uint64_t>(step & 15);
    }
    keys.push_back(cells << 24 | steps);
  }
  std::ranges::sort(keys);
  return keys;
}

}  // namespace

PointCloud thinned_cloud(const PointCloud& cloud, double voxel, double range) {
  PointCloud thin;
  for (const Eigen::Vector3f& p : thinned(cloud, voxel, range))
    thin.points.push_back({p.x(), p.y(), p.z(), 0});
  return thin;
}

std::string compact_cloud(const PointCloud& cloud, const Eigen::Isometry3d& mount,
                          std::optional<double> scale) {
  if (!scale) scale = scene_scale(PreparedScan(cloud));
  const std::vector<uint64_t> keys = sorted_keys(cloud, *scale * kVoxel);
  const size_t n = keys.size();
  std::vector<uint8_t> bytes(n * kPlanes);
  for (size_t plane = 0; plane < kPlanes; ++plane)
    for (size_t i = 0; i < n; ++i) {
      const uint64_t last = plane < 3 && i > 0 ? keys[i - 1] : 0;
      const size_t shift = 8 * (kPlanes - 1 - plane);
      bytes[plane * n + i] = static_cast<uint8_t>((keys[i] >> shift) - (last >> shift));
    }
  z_stream stream{};
  // Bytes repeat, sequences do not: Huffman coding with runs is smaller and faster than others.
  // Blocks of 2048 bytes have codes of their own, as each plane needs.
  constexpr int kMemory = 5;
  if (deflateInit2(&stream, Z_BEST_SPEED, Z_DEFLATED, MAX_WBITS, kMemory, Z_RLE) != Z_OK)
    throw std::bad_alloc();
  const uLong most = deflateBound(&stream, bytes.size());
  std::string result(kHeadBytes + most, '\0');
  stream.next_in = bytes.data();
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(&result[kHeadBytes]);
  stream.avail_out = static_cast<uInt>(most);
  const int state = deflate(&stream, Z_FINISH);
  result.resize(kHeadBytes + stream.total_out);
  deflateEnd(&stream);
  if (state != Z_STREAM_END) throw std::bad_alloc();
  const MountNumbers numbers = mount.matrix().topRows<3>();
  const auto count = static_cast<uint32_t>(n);
  std::memcpy(result.data(), numbers.data(), kMountBytes);
  std::memcpy(&result[kMountBytes], &count, sizeof(count));
  return result;
}

std::pair<PointCloud, Eigen::Isometry3d> expand_cloud(std::string_view bytes) {
  uint32_t n = 0;
  MountNumbers mount = MountNumbers::Zero();
  if (bytes.size() >= kHeadBytes) {
    std::memcpy(mount.data(), bytes.data(), kMountBytes);
    std::memcpy(&n, &bytes[kMountBytes], sizeof(n));
  }
  std::vector<uint8_t> planes(n <= kMaxPoints ? n * kPlanes : 0);
  uLongf size = planes.size();
  if (bytes.size() < kHeadBytes || n > kMaxPoints || !mount.leftCols<3>().isUnitary(1e-6) ||
      !(mount.array().abs() <= kLargestMount).all() ||
      uncompress(planes.data(), &size, reinterpret_cast<const Bytef*>(bytes.data() + kHeadBytes),
                 bytes.size() - kHeadBytes) != Z_OK ||
      size != planes.size())
    throw InputError("a place's points are corrupt: ", bytes.size(), " bytes for ", n, " points");
  std::pair<PointCloud, Eigen::Isometry3d> stored;
  auto& [cloud, T_stored_sensor] = stored;
  T_stored_sensor.matrix().setIdentity();
  T_stored_sensor.matrix().topRows<3>() = mount;
  cloud.points.resize(n);
  for (size_t axis = 0; axis < 3; ++axis) {
    uint8_t cell = 0;
    for (size_t i = 0; i < n; ++i) {
      cell = static_cast<uint8_t>(cell + planes[axis * n + i]);
      const int step = 16 * cell + planes[(axis + 3) * n + i] - kOffset;
      cloud.points[i].*kAxes[axis] = static_cast<float>(step) / kStepsPerMeter;
    }
  }
  return stored;
}

}  // namespace revisit
