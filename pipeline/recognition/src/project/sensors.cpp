#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

namespace {

/// `image_top`, `image_bottom` [deg]; closing rectangle in pixels of 4000 x 112.
Sensor sensor(const char* name, const char* model, int beams, double top, double bottom,
              double image_top, double image_bottom, int closing_width, int closing_height) {
  Sensor made{name, model, beams, top, bottom, {}};
  made.image.elevation_top = image_top;
  made.image.elevation_bottom = image_bottom;
  made.image.closing_width = closing_width * 360.0 / made.image.width;
  made.image.closing_height = closing_height * (image_top - image_bottom) / made.image.height;
  return made;
}

}  // namespace

const std::vector<Sensor>& sensors() {
  static const std::vector<Sensor> all = {
      sensor("hdl64", "Velodyne HDL-64E", 64, 2, -24.8, 3, -25, 5, 3),
      sensor("hdl32", "Velodyne HDL-32E", 32, 10.67, -30.67, 34.0 / 3, -94.0 / 3, 5, 5),
      sensor("vlp16", "Velodyne VLP-16", 16, 15, -15, 16, -16, 5, 9),
      sensor("ouster-os0-32", "Ouster OS0-32", 32, 45, -45, 46.5, -46.5, 5, 5),
      sensor("ouster-os0-64", "Ouster OS0-64", 64, 45, -45, 46, -46, 5, 3),
      sensor("ouster-os0-128", "Ouster OS0-128", 128, 45, -45, 45.5, -45.5, 5, 3),
      sensor("ouster-os1-64", "Ouster OS1-64", 64, 22.5, -22.5, 23, -23, 5, 3),
      sensor("ouster-os1-64-gen1", "Ouster OS1-64, generation 1", 64, 16.6, -16.6, 17.5, -17.5, 5,
             3),
      sensor("ouster-os1-128", "Ouster OS1-128", 128, 22.5, -22.5, 23, -23, 5, 3),
      sensor("ouster-os2-64", "Ouster OS2-64", 64, 11.25, -11.25, 11.5, -11.5, 5, 3),
      sensor("ouster-os2-128", "Ouster OS2-128", 128, 11.25, -11.25, 11.5, -11.5, 5, 3),
      sensor("pandar64", "Hesai Pandar64", 64, 15, -25, 15.5, -25.5, 5, 5),
      sensor("pandar-xt32", "Hesai PandarXT-32", 32, 15, -16, 15.5, -16.5, 5, 5),
      sensor("livox-mid360", "Livox Mid-360", 0, 52, -7, 52.5, -7.5, 15, 5),
  };
  return all;
}

ImageGeometry sensor_geometry(const std::string& sensor) {
  for (const Sensor& known : sensors())
    if (known.name == sensor) return known.image;
  throw UsageError("unknown sensor '", sensor, "'", nearest_name_hint(sensor, sensor_names()),
                   "; known: ", joined(sensor_names(), " "));
}

std::vector<std::string> sensor_names() {
  std::vector<std::string> names;
  for (const Sensor& sensor : sensors()) names.push_back(sensor.name);
  return names;
}

namespace {

constexpr double kDegree = std::numbers::pi / 180;

double elevation_of(const Point& p) {
  return std::atan2(double{p.z}, std::hypot(double{p.x}, double{p.y})) / kDegree;
}

/// [deg], ascending. Ignores near points if others suffice, because lasers are off the origin.
std::vector<double> elevations_of(const std::vector<PointCloud>& scans) {
  constexpr float kNear = 2;  // [m]
  std::vector<double> all, far;
  for (const PointCloud& scan : scans)
    for (const Point& p : scan.points) {
      if (!is_return(p)) continue;
      all.push_back(elevation_of(p));
      if (std::hypot(p.x, p.y, p.z) > kNear) far.push_back(all.back());
    }
  std::vector<double>& used = 2 * far.size() > all.size() ? far : all;
  std::sort(used.begin(), used.end());
  return used;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<double> gaps_of(const std::vector<double>& descending) {
  std::vector<double> gaps;
  for (size_t i = 1; i < descending.size(); ++i) gaps.push_back(descending[i - 1] - descending[i]);
  return gaps;
}

/// Finds beams as peaks of the elevation histogram that are at least four times as high as the
/// adjacent valleys; top first. Empty if most points are in no peak, e.g. after tilt or motion.
std::vector<double> beams_by_elevation(const std::vector<double>& elevations) {
  constexpr double kBin = 0.02;  // [deg]
  constexpr double kDeep = 4, kMinSquares = 4, kWeakest = 0.05, kMost = 0.9;
  constexpr size_t kMinBeams = 4;
  std::vector<double> bins(static_cast<size_t>(180 / kBin) + 3);
  const auto bin_of = [&](double elevation) {
    return static_cast<size_t>((elevation + 90) / kBin) + 1;
  };
  for (const double elevation : elevations) ++bins[bin_of(elevation)];

  std::vector<std::pair<double, double>> peaks;  // elevation, height
  double valley = 0, height = 0;
  size_t top = 0;
  for (size_t i = bins.size() - 2; i > 0; --i) {
    const double here = bins[i - 1] + bins[i] + bins[i + 1];
    if (height == 0) {
      valley = std::min(valley, here);
      if (here >= kMinSquares && here > kDeep * valley) height = here, top = i;
    } else if (here > height) {
      height = here, top = i;
    } else if (kDeep * here < height) {
      peaks.emplace_back((static_cast<double>(top) - 0.5) * kBin - 90, height);
      valley = here;
      height = 0;
    }
  }
  if (peaks.size() < kMinBeams) return {};
  std::vector<double> heights;
  for (const auto& peak : peaks) heights.push_back(peak.second);
  const double weakest = kWeakest * median(heights);
  std::erase_if(peaks, [&](const auto& peak) { return peak.second < weakest; });
  std::vector<double> beams;
  for (const auto& peak : peaks) beams.push_back(peak.first);
  if (beams.size() < kMinBeams) return {};

  const double around = median(gaps_of(beams)) / 4;
  size_t in_peaks = 0;
  for (const double beam : beams)
    in_peaks +=
        static_cast<size_t>(std::upper_bound(elevations.begin(), elevations.end(), beam + around) -
                            std::lower_bound(elevations.begin(), elevations.end(), beam - around));
  return static_cast<double>(in_peaks) > kMost * static_cast<double>(elevations.size())
             ? beams
             : std::vector<double>{};
}

/// Median elevation of each revolution in point order (KITTI), top first. Empty for another order.
std::vector<double> beams_by_order(const PointCloud& scan) {
  constexpr size_t kMinPoints = 20, kMinBeams = 8, kMaxBeams = 256;
  constexpr double kMargin = 2 * kDegree, kInOrder = 0.9;
  std::vector<std::vector<double>> revolutions(1);
  double start = 0, last = 0;
  int turns = 0, most_turns = 0;
  bool first = true;
  for (const Point& p : scan.points) {
    if (!is_return(p)) continue;
    const double azimuth = std::atan2(double{p.y}, double{p.x});
    if (first) start = azimuth - kMargin;
    double angle = std::remainder(azimuth - start, 2 * std::numbers::pi);
    if (angle < 0) angle += 2 * std::numbers::pi;
    if (!first && std::abs(angle - last) > std::numbers::pi) turns += angle < last ? 1 : -1;
    // Points that alternate around the start of a revolution do not begin another one.
    if (std::abs(turns) > most_turns) {
      most_turns = std::abs(turns);
      revolutions.emplace_back();
    }
    revolutions.back().push_back(elevation_of(p));
    last = angle;
    first = false;
  }
  std::vector<double> beams;
  for (const std::vector<double>& elevations : revolutions)
    if (elevations.size() >= kMinPoints) beams.push_back(median(elevations));
  if (beams.size() < kMinBeams || beams.size() > kMaxBeams) return {};
  if (beams.front() < beams.back()) std::reverse(beams.begin(), beams.end());
  const std::vector<double> gaps = gaps_of(beams);
  const auto in_order = std::count_if(gaps.begin(), gaps.end(), [](double gap) { return gap > 0; });
  if (static_cast<double>(in_order) < kInOrder * static_cast<double>(gaps.size())) return {};
  std::sort(beams.rbegin(), beams.rend());
  return beams;
}

double inside(const ImageGeometry& geometry, const std::vector<PointCloud>& scans) {
  int64_t returns = 0, outside = 0;
  RangeImage image;
  for (const PointCloud& scan : scans) {
    project_rotated(scan, Eigen::Matrix3f::Identity(), geometry, image);
    returns += image.returns;
    outside += image.outside;
  }
  return returns ? 1 - static_cast<double>(outside) / static_cast<double>(returns) : 0;
}

double mean_gap(double top, double bottom, size_t beams) {
  return (top - bottom) / static_cast<double>(beams - 1);
}

/// [deg], or infinity. The highest beams may be missing (sky).
double distance(const SensorFound& found, const Sensor& sensor) {
  constexpr double kNo = std::numeric_limits<double>::infinity();
  const size_t n = found.elevations.size();
  if (!n) {
    // Without fixed beams and in the open, returns end anywhere below the sensor's top.
    const double above = sensor.beams ? 2 : 15;
    const double top = sensor.image.elevation_top - found.top;
    const double bottom = found.bottom - sensor.image.elevation_bottom;
    return top < above && top > -2 && std::abs(bottom) < 2 ? std::abs(top) + std::abs(bottom) : kNo;
  }
  if (!sensor.beams) return kNo;
  const auto beams = static_cast<double>(sensor.beams);
  const double gap = mean_gap(sensor.top, sensor.bottom, static_cast<size_t>(sensor.beams));
  const double top = sensor.top - found.elevations.front();
  const double bottom = found.elevations.back() - sensor.bottom;
  const double found_gap = mean_gap(found.elevations.front(), found.elevations.back(), n);
  const bool fits = static_cast<double>(n) > 0.6 * beams && static_cast<double>(n) < 1.1 * beams &&
                    std::abs(found_gap / gap - 1) < 0.08 && top > -1.5 && std::abs(bottom) < 1.5;
  return fits ? std::abs(top) + std::abs(bottom) : kNo;
}

/// Makes an image half a beam larger than the beams, in half degrees, with 99 % of the returns.
ImageGeometry own_image(const SensorFound& found) {
  const std::vector<double>& beams = found.elevations;
  ImageGeometry image;
  double top = found.top, bottom = found.bottom, gap = 0;
  if (!beams.empty()) {
    const double half = mean_gap(beams.front(), beams.back(), beams.size()) / 2;
    top = std::max(top, beams.front() + half);
    bottom = std::min(bottom, beams.back() - half);
    std::vector<double> gaps = gaps_of(beams);
    std::sort(gaps.begin(), gaps.end());
    gap = gaps[gaps.size() * 9 / 10];  // some sensors have a few beams far below the others
  }
  constexpr double kMargin = 0.1;  // [deg], so that beams at whole degrees give one image
  image.elevation_top = std::min(90.0, std::floor(2 * (top + kMargin)) / 2 + 0.5);
  image.elevation_bottom = std::max(-90.0, std::ceil(2 * (bottom - kMargin)) / 2 - 0.5);
  const double row = (image.elevation_top - image.elevation_bottom) / image.height;
  const int rows = std::max(2, static_cast<int>(std::ceil(gap / row))) + 1;
  image.closing_height = std::min(rows + (rows + 1) % 2, image.height) * row;
  return image;
}

}  // namespace

SensorFound find_beams(const std::vector<PointCloud>& scans) {
  const std::vector<double> elevations = elevations_of(scans);
  SensorFound found;
  if (elevations.empty()) return found;
  const auto last = static_cast<double>(elevations.size() - 1);
  found.top = elevations[static_cast<size_t>(std::ceil(0.995 * last))];
  found.bottom = elevations[static_cast<size_t>(std::floor(0.005 * last))];
  found.elevations = beams_by_elevation(elevations);
  if (found.elevations.empty()) found.elevations = beams_by_order(scans.front());
  return found;
}

SensorFound find_sensor(const std::vector<PointCloud>& scans) {
  constexpr double kMaxPoints = 0.97;
  SensorFound found = find_beams(scans);
  double nearest = std::numeric_limits<double>::infinity();
  for (const Sensor& sensor : sensors()) {
    const double far = distance(found, sensor);
    if (far >= nearest || inside(sensor.image, scans) < kMaxPoints) continue;
    nearest = far;
    found.name = sensor.name;
    found.image = sensor.image;
  }
  if (found.name.empty()) found.image = own_image(found);
  found.inside = inside(found.image, scans);
  return found;
}

}  // namespace revisit
