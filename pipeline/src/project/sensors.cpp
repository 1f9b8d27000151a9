#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "revisit/pipeline/range_image.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

constexpr double kMaxRange = 80;  // [m]

const std::array<std::pair<const char*, ImageGeometry>, 3> kSensors = {{
    {"hdl64", {4000, 112, 3, -25, kMaxRange, 5, 3}},
    {"hdl32", {4000, 112, 34.0 / 3, -94.0 / 3, kMaxRange, 5, 5}},
    {"vlp16", {4000, 112, 16, -16, kMaxRange, 5, 9}},
}};

void check(bool ok, const char* what, const std::string& found) {
  if (!ok) throw UsageError(str("image geometry: ", what, ", found ", found));
}

}  // namespace

ImageGeometry sensor_geometry(const std::string& sensor) {
  for (const auto& [name, geometry] : kSensors)
    if (name == sensor) return geometry;
  std::string names;
  for (const std::string& name : sensor_names()) names += " " + name;
  throw UsageError(str("unknown sensor '", sensor, "'", did_you_mean(sensor, sensor_names()),
                       "; known:", names));
}

std::vector<std::string> sensor_names() {
  std::vector<std::string> names;
  for (const auto& sensor : kSensors) names.emplace_back(sensor.first);
  return names;
}

std::string fitting_sensor(const PointCloud& cloud) {
  constexpr double kOutside = 0.01;
  std::string best;
  double lowest = std::numeric_limits<double>::infinity();
  RangeImage image;
  for (const auto& [name, geometry] : kSensors) {
    const double degrees = geometry.elevation_top - geometry.elevation_bottom;
    if (degrees >= lowest ||
        project_turned(cloud, Eigen::Matrix3f::Identity(), geometry, image).outside_share() >
            kOutside)
      continue;
    best = name;
    lowest = degrees;
  }
  return best;
}

void check_geometry(const ImageGeometry& g) {
  constexpr int kLargest = 1 << 16;         // [pixels]
  constexpr int64_t kMostPixels = 1 << 26;  // 256 MB
  check(g.width >= 1 && g.width <= kLargest, "expected a width from 1 to 65536", str(g.width));
  check(g.height >= 1 && g.height <= kLargest, "expected a height from 1 to 65536", str(g.height));
  check(int64_t{g.width} * g.height <= kMostPixels, "expected at most 67108864 pixels",
        str(g.width, " x ", g.height));
  check(g.elevation_top <= 90 && g.elevation_bottom >= -90 && g.elevation_top > g.elevation_bottom,
        "expected 90 >= top > bottom >= -90 degrees of elevation",
        str("top ", g.elevation_top, ", bottom ", g.elevation_bottom));
  check(g.max_range > 0 && std::isfinite(g.max_range), "expected a maximum range above 0 m",
        str(g.max_range));
  const auto fits = [](int side, int most) { return side >= 1 && side <= most && side % 2 == 1; };
  check(fits(g.closing_width, g.width) && fits(g.closing_height, g.height),
        "expected a closing rectangle of odd sides, no larger than the image",
        str(g.closing_width, " x ", g.closing_height));
}

}  // namespace revisit::pipeline
