#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <new>
#include <vector>

#include "prepared_scan.h"
#include "revisit/base/error.h"
#include "revisit/registration/registration.h"

// Format: mount, 12 float64 [3][4]; number of points; then deflated bytes, axis by axis:
// differences of the cells of consecutive points, then the steps within the cells, 0 to 15. Points
// are sorted by cells of 16 steps, so that the differences are small.
namespace revisit {
namespace {

constexpr double kVoxel = 0.4, kRange = 60;  // [m]
constexpr float kStepsPerMeter = 32;
constexpr int kOffset = 2048;  // [steps], so that coordinates are positive: 12 bits
static_assert(kRange * kStepsPerMeter < kOffset);
constexpr uint32_t kMaxPoints = 1 << 20;
constexpr float Point::*kAxes[] = {&Point::x, &Point::y, &Point::z};

using MountNumbers = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
constexpr size_t kMountBytes = sizeof(MountNumbers), kHeadBytes = kMountBytes + sizeof(uint32_t);

constexpr int kPlanes = 6;  // of one byte per point

size_t bytes_of(size_t points) {
  return points * kPlanes;
}

/// The cells of a point, 8 bits each (x, y, z), then its steps within them, 4 bits each. Sorted.
std::vector<uint64_t> sorted_keys(const std::vector<Eigen::Vector3f>& points) {
  std::vector<uint64_t> keys;
  keys.reserve(points.size());
  for (const Eigen::Vector3f& point : points) {
    uint64_t cells = 0, steps = 0;
    for (const float x : point) {
      const auto step = static_cast<uint16_t>(std::lround(x * kStepsPerMeter) + kOffset);
      cells = cells << 8 | step >> 4;
      steps = steps << 4 | (step & 15);
    }
    keys.push_back(cells << 12 | steps);
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

std::string compact_cloud(const PointCloud& cloud, const Eigen::Isometry3d& mount) {
  const std::vector<uint64_t> keys = sorted_keys(thinned(cloud, kVoxel, kRange));
  const size_t n = std::min<size_t>(keys.size(), kMaxPoints);
  std::vector<uint8_t> bytes(bytes_of(n));
  for (int axis = 0; axis < 3; ++axis) {
    uint8_t last = 0;
    for (size_t i = 0; i < n; ++i) {
      const auto cell = static_cast<uint8_t>(keys[i] >> (28 - 8 * axis));
      const size_t at = static_cast<size_t>(2 * axis) * n + i;
      bytes[at] = static_cast<uint8_t>(cell - last);
      bytes[at + n] = static_cast<uint8_t>(keys[i] >> (8 - 4 * axis) & 15);
      last = cell;
    }
  }
  const uLong most = compressBound(bytes.size()) + 8 * kPlanes;  // of a few points: ends of blocks
  std::string result(kHeadBytes + most, '\0');
  z_stream stream{};
  // Bytes repeat, sequences do not: Huffman coding with runs is smaller and faster than others.
  constexpr int kDefaultMemory = 8;
  if (deflateInit2(&stream, Z_BEST_SPEED, Z_DEFLATED, MAX_WBITS, kDefaultMemory, Z_RLE) != Z_OK)
    throw std::bad_alloc();
  stream.next_in = bytes.data();
  stream.next_out = reinterpret_cast<Bytef*>(&result[kHeadBytes]);
  stream.avail_out = static_cast<uInt>(most);
  int state = Z_OK;
  for (int plane = 0; plane < kPlanes; ++plane) {  // each with Huffman codes of its own
    stream.avail_in = static_cast<uInt>(n);
    state = deflate(&stream, plane + 1 < kPlanes ? Z_BLOCK : Z_FINISH);
  }
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
  std::vector<uint8_t> planes(bytes_of(n <= kMaxPoints ? n : 0));
  uLongf size = planes.size();
  if (bytes.size() < kHeadBytes || n > kMaxPoints || !mount.leftCols<3>().isUnitary(1e-6) ||
      !mount.allFinite() ||
      uncompress(planes.data(), &size, reinterpret_cast<const Bytef*>(&bytes[kHeadBytes]),
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
      const size_t at = 2 * axis * n + i;
      cell = static_cast<uint8_t>(cell + planes[at]);
      const int step = 16 * cell + planes[at + n] - kOffset;
      cloud.points[i].*kAxes[axis] = static_cast<float>(step) / kStepsPerMeter;
    }
  }
  return stored;
}

}  // namespace revisit
