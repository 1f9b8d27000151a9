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

// Format: mount, 12 float64 [3][4]; number of points; then deflated differences of consecutive
// points, axis by axis, first the low and then the high bytes.
namespace revisit {
namespace {

constexpr double kVoxel = 0.4, kRange = 60;  // [m]
constexpr float kStepsPerMeter = 32;
constexpr uint32_t kMaxPoints = 1 << 20;
constexpr float Point::*kAxes[] = {&Point::x, &Point::y, &Point::z};

using MountNumbers = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
constexpr size_t kMountBytes = sizeof(MountNumbers), kHeadBytes = kMountBytes + sizeof(uint32_t);

size_t bytes_of(size_t points) {
  return points * 3 * sizeof(uint16_t);
}

}  // namespace

PointCloud thinned_cloud(const PointCloud& cloud, double voxel, double range) {
  PointCloud thin;
  for (const Eigen::Vector3f& p : thinned(cloud, voxel, range))
    thin.points.push_back({p.x(), p.y(), p.z(), 0});
  return thin;
}

std::string compact_cloud(const PointCloud& cloud, const Eigen::Isometry3d& mount) {
  const std::vector<Eigen::Vector3f> points = thinned(cloud, kVoxel, kRange);
  const size_t n = std::min<size_t>(points.size(), kMaxPoints);
  std::vector<uint8_t> bytes(bytes_of(n));
  for (int axis = 0; axis < 3; ++axis) {
    uint16_t last = 0;
    for (size_t i = 0; i < n; ++i) {
      const auto step = static_cast<uint16_t>(std::lround(points[i][axis] * kStepsPerMeter));
      const auto difference = static_cast<uint16_t>(step - last);
      const size_t at = static_cast<size_t>(2 * axis) * n + i;
      bytes[at] = static_cast<uint8_t>(difference & 0xFF);
      bytes[at + n] = static_cast<uint8_t>(difference >> 8);
      last = step;
    }
  }
  const uLong most = compressBound(bytes.size());
  std::string result(kHeadBytes + most, '\0');
  z_stream stream{};
  // Bytes of the differences repeat, sequences do not: Huffman coding alone is smaller and faster.
  constexpr int kDefaultMemory = 8;
  if (deflateInit2(&stream, Z_BEST_SPEED, Z_DEFLATED, MAX_WBITS, kDefaultMemory, Z_HUFFMAN_ONLY) !=
      Z_OK)
    throw std::bad_alloc();
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
  std::vector<uint8_t> differences(bytes_of(n <= kMaxPoints ? n : 0));
  uLongf size = differences.size();
  if (bytes.size() < kHeadBytes || n > kMaxPoints || !mount.leftCols<3>().isUnitary(1e-6) ||
      !mount.allFinite() ||
      uncompress(differences.data(), &size, reinterpret_cast<const Bytef*>(&bytes[kHeadBytes]),
                 bytes.size() - kHeadBytes) != Z_OK ||
      size != differences.size())
    throw InputError("a place's points are corrupt: ", bytes.size(), " bytes for ", n, " points");
  std::pair<PointCloud, Eigen::Isometry3d> stored;
  auto& [cloud, T_stored_sensor] = stored;
  T_stored_sensor.matrix().setIdentity();
  T_stored_sensor.matrix().topRows<3>() = mount;
  cloud.points.resize(n);
  for (size_t axis = 0; axis < 3; ++axis) {
    uint16_t step = 0;
    for (size_t i = 0; i < n; ++i) {
      const size_t at = 2 * axis * n + i;
      step = static_cast<uint16_t>(step + differences[at] + 256 * differences[at + n]);
      Point& point = cloud.points[i];
      point.*kAxes[axis] = static_cast<float>(static_cast<int16_t>(step)) / kStepsPerMeter;
    }
  }
  return stored;
}

}  // namespace revisit
