#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <numbers>
#include <sstream>

#include "revisit/base/error.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/point_cloud.h"

namespace revisit {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;

struct Plane {
  double fraction = 0;  // points within 30 m: fraction within 0.2 m of it minus fraction below it
  double above = 0;     // fraction of all points more than 3 m above it
};
Plane ground_of(const PointCloud& cloud, const Eigen::Vector3f& down) {
  constexpr float kAllRound = 30, kLeast = -0.5, kMost = 4, kBin = 0.2F, kHigh = 3;  // [m]
  std::array<int64_t, static_cast<size_t>((kMost - kLeast) / kBin) + 2> bins{};
  int64_t near = 0, below = 0, all = 0, above = 0;
  const auto for_each = [&](const auto& take) {
    for (const Point& point : cloud.points)
      if (const Eigen::Vector3f p(point.x, point.y, point.z); is_return(point))
        take(p.dot(down), p.norm());
  };
  for_each([&](float depth, float range) {
    ++all;
    if (range > kAllRound) return;
    ++near;
    if (depth >= kMost)
      ++below;
    else if (depth >= kLeast)
      ++bins[static_cast<size_t>((depth - kLeast) / kBin)];
  });
  if (near == 0) return {};
  const auto* const peak = std::ranges::max_element(bins);
  const float plane = kLeast + kBin * static_cast<float>(peak - bins.begin());
  for_each([&](float depth, float) { above += depth < plane - kHigh ? 1 : 0; });
  for (const auto* bin = peak + std::min<std::ptrdiff_t>(3, bins.end() - peak); bin < bins.end();
       ++bin)
    below += *bin;
  const int64_t on_it =
      *peak + (peak + 1 < bins.end() ? *(peak + 1) : 0) + (peak > bins.begin() ? *(peak - 1) : 0);
  return {static_cast<double>(on_it - 2 * below) / static_cast<double>(near),
          static_cast<double>(above) / static_cast<double>(all)};
}

struct Axes {
  Eigen::Vector3f down;
  size_t opposite;
  const char* misfit;
};
const std::array kAxes{
    Axes{-Eigen::Vector3f::UnitZ(), 1, ""},
    Axes{Eigen::Vector3f::UnitZ(), 0,
         "the ground is above: the sensor is upside down; take the mount 180,0,0,0,0,0, "
         "after one that is given"},
    Axes{Eigen::Vector3f::UnitY(), 3,
         "the ground is at +y, as with a camera's axes (x right, y down, z forward); take the "
         "mount -90,0,-90,0,0,0, after one that is given"},
    Axes{-Eigen::Vector3f::UnitY(), 2,
         "the ground is at -y, as with axes whose y points upwards; take the mount 90,0,0,0,0,0, "
         "after one that is given"},
};

std::string misfit_of_axes(const std::vector<PointCloud>& scans) {
  constexpr double kClear = 0.25, kNone = 0.1, kMinSquares = 0.001;
  std::array<double, kAxes.size()> fractions{}, high{};
  for (const PointCloud& scan : scans)
    for (size_t i = 0; i < kAxes.size(); ++i) {
      const auto [fraction, above] = ground_of(scan, kAxes[i].down);
      fractions[i] += fraction / static_cast<double>(scans.size());
      high[i] += above / static_cast<double>(scans.size());
    }
  const auto best = static_cast<size_t>(std::ranges::max_element(fractions) - fractions.begin());
  // A corridor also has a wall on the other side; a tunnel has no high points.
  const bool is_clear = fractions[0] < kNone && high[best] > kMinSquares &&
                        fractions[best] - fractions[kAxes[best].opposite] > kClear;
  return is_clear ? kAxes[best].misfit : "";
}

/// True if no point is close and not all sides have points, which does not occur around a sensor.
bool is_seen_from_afar(const PointCloud& scan) {
  constexpr double kFar = 15, kSector = 20 * kRadiansPerDegree;
  std::vector<double> ranges;
  std::array<int64_t, 18> sectors{};
  for (const Point& p : scan.points) {
    if (!is_return(p)) continue;
    ranges.push_back(std::hypot(p.x, p.y));
    const double azimuth = std::atan2(double{p.y}, double{p.x}) + std::numbers::pi;
    ++sectors[std::min<size_t>(static_cast<size_t>(azimuth / kSector), sectors.size() - 1)];
  }
  if (ranges.size() < 100) return false;  // too few to show sides
  const auto nearest = ranges.begin() + std::ssize(ranges) / 50;
  std::ranges::nth_element(ranges, nearest);
  const auto fewest = std::ssize(ranges) / 200;
  const auto seen = std::ranges::count_if(sectors, [&](int64_t n) { return n > fewest; });
  return *nearest > kFar && seen < 10;
}

template <class Number>
void copy_coordinates(const PointsView& points, PointCloud& cloud) {
  const auto* from = static_cast<const std::byte*>(points.data);
  const auto at = [&](size_t offset) {
    Number value;
    std::memcpy(&value, from + offset, sizeof value);  // may be unaligned
    return static_cast<float>(value);
  };
  for (Point& point : cloud.points) {
    point = {at(points.x), at(points.y), at(points.z), 0};
    from += points.stride;
  }
}

}  // namespace

Eigen::Isometry3d parse_mount(const std::string& text) {
  std::array<double, 6> numbers{};
  std::istringstream fields(text);
  size_t n = 0;
  bool valid = true;
  for (std::string field; std::getline(fields, field, ','); ++n) {
    char* end = nullptr;
    const double value = std::strtod(field.c_str(), &end);
    valid &= n < numbers.size() && !field.empty() && *end == '\0' && std::isfinite(value);
    if (valid) numbers[n] = value;
  }
  if (!valid || n != numbers.size() || text.ends_with(','))
    throw UsageError("mount: expected roll,pitch,yaw,x,y,z in degrees and meters, found '", text,
                     "'");
  const auto turn = [&](size_t i, const Eigen::Vector3d& axis) {
    return Eigen::AngleAxisd(numbers[i] * kRadiansPerDegree, axis);
  };
  return Eigen::Translation3d(numbers[3], numbers[4], numbers[5]) *
         turn(2, Eigen::Vector3d::UnitZ()) * turn(1, Eigen::Vector3d::UnitY()) *
         turn(0, Eigen::Vector3d::UnitX());
}

void transform(const Eigen::Isometry3d& T, PointCloud& cloud) {
  if (T.matrix().isIdentity(0)) return;
  const Eigen::Isometry3f t = T.cast<float>();
  for (Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const Eigen::Vector3f p = t * Eigen::Vector3f(point.x, point.y, point.z);
    point.x = p.x();
    point.y = p.y();
    point.z = p.z();
  }
}

std::string find_unit_defect(const PointCloud& cloud) {
  constexpr float kMaxRange = 500;  // [m]
  int64_t returns = 0, far = 0;
  for (const Point& p : cloud.points) {
    if (!is_return(p)) continue;
    ++returns;
    far += std::hypot(p.x, p.y, p.z) > kMaxRange ? 1 : 0;
  }
  return far > returns / 2 ? "half of the points are farther than 500 m: coordinates must be in "
                             "meters; these may be millimeters"
                           : "";
}

std::string find_view_defect(const std::vector<PointCloud>& scans) {
  if (std::ranges::any_of(scans, is_seen_from_afar))
    return "all points of a scan are far from the origin, on one side: they are in the frame of a "
           "map, not of the sensor";
  return misfit_of_axes(scans);
}

void copy_points(const PointsView& points, PointCloud& cloud) {
  const size_t last = std::max({points.x, points.y, points.z}) +
                      (points.is_double ? sizeof(double) : sizeof(float));
  if (points.stride < last)
    throw UsageError("points: expected a stride of at least ", last,
                     " bytes for the coordinates, found ", points.stride);
  if (!points.data && points.count > 0)
    throw UsageError("points: ", points.count, " points without data");
  cloud.points.resize(points.count);
  cloud.times.clear();
  if (!points.data) return;
  if (points.is_double)
    copy_coordinates<double>(points, cloud);
  else
    copy_coordinates<float>(points, cloud);
}

}  // namespace revisit
