#include "lidar.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "random.h"
#include "revisit/base/error.h"
#include "road_map.h"

namespace revisit::simulation {
namespace {

constexpr double kMinRange = 0.9;     // blind zone of sensors for cars [m]
constexpr float kRangeStep = 0.002f;  // resolution of the sensors [m]
/// Returns with signal * kSensitivity << 1 are lost, where signal = reflectance * cos(incidence) /
/// range^2 (link budget of a surface larger than the beam). Chosen so that dry asphalt is visible
/// up to about 50 m, as in KITTI.
constexpr float kSensitivity = 1.7e5f;  // [m^2]

constexpr size_t kPatch = 9;  // adjacent rays of one beam

enum Purpose : uint64_t { kPhase = 1, kRange, kRoughness, kDetection, kIntensity };

/// Roof of the sensor's car: a horizontal rectangle below and behind it, from KITTI's blind area.
bool meets_roof(const Eigen::Vector3f& direction) {
  constexpr float kBelow = 0.25f, kRear = -0.85f, kFront = 0.35f, kHalfWidth = 0.45f;  // [m]
  if (direction.z() >= 0) return false;
  const float t = -kBelow / direction.z();
  const float x = t * direction.x(), y = t * direction.y();
  return x > kRear && x < kFront && std::abs(y) < kHalfWidth;
}

/// Point in the unit circle: two counter-rotating prisms trace petals. `scans`: time in scans.
Eigen::Vector2d on_rosette(double scans) {
  constexpr double kFirst = 2 * std::numbers::pi * 12.157, kSecond = -2 * std::numbers::pi * 7.778;
  return {(std::cos(kFirst * scans) + std::cos(kSecond * scans)) / 2,
          (std::sin(kFirst * scans) + std::sin(kSecond * scans)) / 2};
}

/// Azimuth and elevation of one of the Mid-360's four lines: they turn together and nod once in
/// about a scan, and each circle is tilted against the next. Rates as in the pattern that Livox
/// publishes for simulators; they are incommensurate, so no scan repeats another.
Eigen::Vector2d on_nodding(const Eigen::Vector2d& field, double scans, size_t line) {
  constexpr double kTurns = 17.361, kNods = 1.00317;  // per scan
  constexpr double kTilt = 2 * kDegree;
  const auto phase = [&](double per_scan) {
    return per_scan * scans - std::floor(per_scan * scans);
  };
  const double azimuth = -2 * std::numbers::pi * phase(kTurns);
  const double nod = std::abs(2 * phase(kNods) - 1), widest = 1.5 * kTilt;
  return {azimuth, field.x() + widest + (field.y() - field.x() - 2 * widest) * nod +
                       (static_cast<double>(line) - 1.5) * kTilt * std::cos(azimuth)};
}

float roughness(Material material) {
  switch (material) {
    case Material::kLawn:
      return 0.025f;
    case Material::kLeaves:
      return 0.05f;
    default:
      return 0;
  }
}

float detection_probability(const Hit& hit) {
  const float reflectance = static_cast<float>(hit.surface.reflectance) / 255;
  const float signal = reflectance * hit.cos_incidence / (hit.range * hit.range);
  const float p = 1 - std::exp(-kSensitivity * signal);
  switch (hit.surface.material) {
    case Material::kGlass:
      return 0.45f * p;
    case Material::kPaint:
      return hit.cos_incidence < 0.3f ? 0.6f * p : 0.95f * p;
    default:
      return p;
  }
}

}  // namespace

BeamPattern beam_pattern(const std::string& sensor) {
  BeamPattern pattern;
  const auto beams = [&](int count, double top, double bottom, int azimuths, double max_range,
                         double min_range = kMinRange) {
    for (int i = 0; i < count; ++i)
      pattern.elevation.push_back((top - (top - bottom) * i / (count - 1)) * kDegree);
    pattern.azimuth_offset.assign(pattern.elevation.size(), 0);
    pattern.azimuths = azimuths;
    pattern.max_range = max_range;
    pattern.min_range = min_range;
    return pattern;
  };
  if (sensor == "vlp16") return beams(16, 15, -15, 1800, 100, 0.5);
  if (sensor == "hdl32") return beams(32, 10.67, -30.67, 2172, 100);
  if (sensor == "pandar-xt32") return beams(32, 15, -16, 2000, 120, 0.3);
  if (sensor == "ouster-os0-32") return beams(32, 45, -45, 1024, 50, 0.3);
  if (sensor == "ouster-os1-64") return beams(64, 22.5, -22.5, 2048, 120, 0.5);
  if (sensor == "front120") {
    pattern.field = 120 * kDegree;
    return beams(64, 12.5, -12.5, 300, 150);
  }
  if (sensor == "livox-mid360") {
    pattern.nodding = Eigen::Vector2d(-7, 52) * kDegree;
    return beams(1, 0, -1, 20000, 70, 0.1);
  }
  if (sensor == "livox-avia") {
    pattern.rosette = Eigen::Vector2d(70.4, 77.2) / 2 * kDegree;
    return beams(1, 0, -1, 24000, 190);
  }
  if (sensor != "hdl64")
    throw UsageError(
        "sensor: expected hdl64, hdl32, vlp16, pandar-xt32, ouster-os0-32, ouster-os1-64, "
        "livox-mid360, front120 or livox-avia, found '",
        sensor, "'");
  // Two blocks of 32 lasers: 1/3 deg apart from +2 deg, then about 1/2 deg apart to -24.8 deg.
  for (int i = 0; i < 32; ++i) pattern.elevation.push_back((2 - i / 3.0) * kDegree);
  const double first = 2 - 31 / 3.0 - 0.5;
  beams(32, first, -24.8, 2083, 120);
  // Residual azimuth offsets of the four laser columns after calibration.
  for (size_t i = 0; i < 64; ++i)
    pattern.azimuth_offset[i] = (static_cast<double>(i % 4) - 1.5) * 0.04 * kDegree;
  pattern.on_car_roof = true;
  return pattern;
}

void check(const NoiseModel& noise) {
  if (!(noise.range_sigma >= 0 && noise.range_sigma <= 1))
    throw UsageError("range noise of ", noise.range_sigma, " m: expected 0 to 1 m");
  if (!(noise.dropout >= 0 && noise.dropout < 1))
    throw UsageError("dropout ", noise.dropout, ": expected a fraction in [0, 1)");
}

Lidar::Lidar(const BeamPattern& pattern, const NoiseModel& noise, uint64_t seed)
    : pattern_(pattern), noise_(noise), seed_(seed) {
  const size_t rays = pattern.elevation.size() * static_cast<size_t>(pattern.azimuths);
  directions_.resize(rays);
  world_directions_.resize(rays);
  hits_.resize(rays);
}

PointCloud Lidar::scan(int frame, const Pose& T_world_velo, RayCaster& scene,
                       const std::function<Eigen::Isometry3d(double time)>& motion) {
  const uint64_t frame_seed = random_bits(seed_, 0x7363616e, static_cast<uint64_t>(frame));
  const auto azimuths = static_cast<size_t>(pattern_.azimuths);
  const double step = pattern_.field / pattern_.azimuths;
  const bool turns = pattern_.field > std::numbers::pi;
  const double start = 1000 * static_cast<double>(unit_float(random_bits(frame_seed, kPhase)));
  // The encoder's phase differs between revolutions.
  const double phase = step * static_cast<double>(unit_float(random_bits(frame_seed, kPhase)));

  std::vector<Eigen::Isometry3f> T_world_then = {T_world_velo.cast<float>()};  // [azimuth], or one
  const double column_period = kFramePeriod / pattern_.azimuths;               // [s]
  if (motion)
    for (size_t k = 1; k < azimuths; ++k)
      T_world_then.push_back(
          (T_world_velo * motion(static_cast<double>(k) * column_period)).cast<float>());
  origins_.resize(motion ? directions_.size() : 1);
  for (size_t beam = 0; beam < pattern_.elevation.size(); ++beam) {
    double z = std::sin(pattern_.elevation[beam]), level = std::cos(pattern_.elevation[beam]);
    for (size_t k = 0; k < azimuths; ++k) {
      double azimuth = phase + static_cast<double>(k) * step + pattern_.azimuth_offset[beam];
      if (pattern_.rosette || pattern_.nodding) {
        const double scans = start + static_cast<double>(k) / pattern_.azimuths;
        const Eigen::Vector2d at = pattern_.nodding
                                       ? on_nodding(*pattern_.nodding, scans, k % 4)
                                       : on_rosette(scans).cwiseProduct(*pattern_.rosette);
        azimuth = at.x();
        z = std::sin(at.y());
        level = std::cos(at.y());
      } else if (!turns) {
        azimuth -= pattern_.field / 2;
      }
      const size_t i = beam * azimuths + k;
      directions_[i] = {static_cast<float>(level * std::cos(azimuth)),
                        static_cast<float>(level * std::sin(azimuth)), static_cast<float>(z)};
      const Eigen::Isometry3f& T = T_world_then[motion ? k : 0];
      world_directions_[i] = T.linear() * directions_[i];
      origins_[motion ? i : 0] = T.translation();
    }
  }
  scene.cast(origins_, world_directions_, static_cast<float>(pattern_.max_range), hits_);

  PointCloud cloud;
  cloud.points.reserve(directions_.size());
  const auto sigma = static_cast<float>(noise_.range_sigma);
  for (size_t i = 0; i < directions_.size(); ++i) {
    const Hit& hit = hits_[i];
    if (hit.range < 0 || (pattern_.on_car_roof && meets_roof(directions_[i]))) continue;
    const auto bits = [&](Purpose purpose) { return random_bits(frame_seed, i, purpose); };
    const float kept = static_cast<float>(1 - noise_.dropout) * detection_probability(hit);
    // Glass is lost or seen in patches: adjacent rays share the random number.
    const bool patch = hit.surface.material == Material::kGlass;
    if (unit_float(random_bits(frame_seed, patch ? i / kPatch : i, kDetection)) >= kept) continue;
    float range = hit.range + sigma * normal_float(bits(kRange));
    if (const float rough = roughness(hit.surface.material); rough > 0)
      range += rough * normal_float(bits(kRoughness));
    range = std::round(range / kRangeStep) * kRangeStep;
    if (range < static_cast<float>(pattern_.min_range) ||
        range > static_cast<float>(pattern_.max_range))
      continue;
    const float intensity =
        static_cast<float>(hit.surface.reflectance) / 255 * (0.5f + 0.5f * hit.cos_incidence) +
        0.03f * normal_float(bits(kIntensity));
    const Eigen::Vector3f p = range * directions_[i];
    cloud.points.push_back(
        {p.x(), p.y(), p.z(), std::round(std::clamp(intensity, 0.f, 0.99f) * 100) / 100});
    if (motion)
      cloud.times.push_back(static_cast<float>(static_cast<double>(i % azimuths) * column_period));
  }
  return cloud;
}

}  // namespace revisit::simulation
