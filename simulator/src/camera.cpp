#include "camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "paint.h"
#include "random.h"

namespace revisit::simulation {

namespace {

using Vec3 = Eigen::Vector3f;

constexpr float kFar = 260;         // [m]
constexpr float kHaze = 900;        // distance at which 2/3 of the radiance is air [m]
constexpr float kShadowReach = 80;  // [m]
// Ambient occlusion under cars and benches: this fraction of the sky's light on the ground comes
// from the zenith, and is blocked by anything nearer than kCoverReach.
constexpr float kFromZenith = 0.6f, kCoverReach = 1.5f;
constexpr int kRayTile = 4;
constexpr int kBand = 16;  // image rows per batch, so that their rays stay in the cache
constexpr float kEdgeContrast = 0.1f;
constexpr size_t kEdgeBatch = 8192;  // [rays]

/// Positions of an edge pixel's four rays: a rotated grid, which gives nearly horizontal and
/// vertical edges four steps.
constexpr double kSamples[4][2] = {
    {-0.125, -0.375}, {0.375, -0.125}, {0.125, 0.375}, {-0.375, 0.125}};

float ambient(const Light& light, const Vec3& normal) {
  constexpr float kGround = 0.2f;
  const float up = 0.5f + 0.5f * normal.z();
  const float from_ground = kGround * (light.sky + 0.6f * light.sun * light.to_sun.z());
  return light.sky * up + from_ground * (1 - up);
}

constexpr double kTurnRate = 0.25 * kDegree;  // 15 degrees per hour, an hour per minute [rad/s]
constexpr double kSwingPeriod = 1440;         // period of the sun's elevation [s]
constexpr double kCloudSeconds = 35, kExposureSeconds = 20;
constexpr double kExposureStops = 0.5;

constexpr float kMeanExposure = 0.22f;    // fraction of saturation
constexpr float kFullWell = 6000;         // photons at saturation
constexpr float kReadingNoise = 0.0025f;  // fraction of saturation
constexpr float kGamma = 1.8f;

}  // namespace

Camera::Camera(const CameraModel& model, const Textures& textures, uint64_t seed)
    : model_(model),
      textures_(textures),
      seed_(seed),
      K_inverse_(model.K.inverse()),
      pixel_angle_(static_cast<float>(1 / model.K(0, 0))),
      image_(static_cast<size_t>(model.width) * static_cast<size_t>(model.height)) {}

void Camera::add_ray(double column, double row, const Eigen::Matrix3f& R_world_cam) {
  const Eigen::Vector3d d = K_inverse_ * Eigen::Vector3d(column, row, 1);
  directions_.push_back((R_world_cam * d.cast<float>()).normalized());
}

void Camera::Incoming::add(size_t ray, const Vec3& point, float reflected) {
  rays.push_back(static_cast<uint32_t>(ray));
  points.push_back(point);
  radiance.push_back(reflected);
}

void Camera::receive(const Incoming& light, const Vec3& direction, float reach, RayCaster& scene) {
  obstructed_.resize(light.points.size());
  scene.obstructed(light.points, direction, reach, obstructed_);
  for (size_t k = 0; k < light.rays.size(); ++k)
    if (!obstructed_[k]) radiance_[light.rays[k]] += light.radiance[k];
}

void Camera::look(const Vec3& origin, const Light& light, RayCaster& scene) {
  constexpr float kPi = std::numbers::pi_v<float>;
  hits_.resize(directions_.size()), radiance_.resize(directions_.size());
  scene.cast(origin, directions_, kFar, hits_);
  from_sun_.clear(), from_zenith_.clear();
  const float haze = haze_radiance(light);
  for (size_t i = 0; i < directions_.size(); ++i) {
    const Hit& hit = hits_[i];
    const Vec3& d = directions_[i];
    if (hit.range < 0) {
      radiance_[i] = sky_radiance(light, d, textures_);
      continue;
    }
    const auto& t = hit.mesh->triangles[hit.triangle];
    const auto& v = hit.mesh->vertices;
    Vec3 normal = (v[t[1]] - v[t[0]]).cross(v[t[2]] - v[t[0]]).normalized();
    if (normal.dot(d) > 0) normal = -normal;
    const SurfacePoint point{
        &hit, origin + hit.range * d, normal,
        hit.range * pixel_angle_ / std::sqrt(std::max(hit.cos_incidence, 0.02f))};
    const Paint paint = paint_at(point, textures_);
    const Vec3 outside = point.position + 1e-3f * (1 + 0.1f * hit.range) * normal;
    const float clear = std::exp(-hit.range / kHaze), given_back = paint.albedo / kPi * clear;

    const float diffuse = given_back * ambient(light, normal);
    const bool on_ground = hit.surface.look == Look::kGround;
    radiance_[i] = (on_ground ? 1 - kFromZenith : 1) * diffuse + haze * (1 - clear);
    if (on_ground) from_zenith_.add(i, outside, kFromZenith * diffuse);
    if (paint.gloss > 0) {
      const float flat = 1 - hit.cos_incidence, grazing = flat * flat * flat * flat * flat;
      const Vec3 mirrored = d + 2 * hit.cos_incidence * normal;
      radiance_[i] +=
          clear * (paint.gloss + (1 - paint.gloss) * grazing) *
          (mirrored.z() > 0.1f ? sky_radiance(light, mirrored, textures_) : 0.5f * haze);
    }
    // Leaves transmit light, so their shaded side is bright, too.
    const float facing = normal.dot(light.to_sun);
    const float share =
        hit.surface.look == Look::kLeaves ? 0.25f + 0.5f * std::abs(facing) : std::max(facing, 0.f);
    if (share > 0) from_sun_.add(i, outside, given_back * light.sun * share);
  }
  receive(from_sun_, light.to_sun, kShadowReach, scene);
  receive(from_zenith_, Vec3::UnitZ(), kCoverReach, scene);
}

void Camera::smooth_edges(const Vec3& origin, const Eigen::Matrix3f& R_world_cam,
                          const Light& light, RayCaster& scene) {
  const auto width = static_cast<size_t>(model_.width), height = static_cast<size_t>(model_.height);
  const auto differ = [&](size_t a, size_t b) {
    return std::abs(image_[a] - image_[b]) > kEdgeContrast * (image_[a] + image_[b]);
  };
  pixels_.clear();
  for (size_t row = 0; row < height; ++row)
    for (size_t column = 0; column < width; ++column) {
      const size_t i = row * width + column;
      if ((column > 0 && differ(i, i - 1)) || (column + 1 < width && differ(i, i + 1)) ||
          (row > 0 && differ(i, i - width)) || (row + 1 < height && differ(i, i + width)))
        pixels_.push_back(static_cast<uint32_t>(i));
    }
  for (size_t first = 0; first < pixels_.size(); first += kEdgeBatch / 4) {
    const size_t last = std::min(first + kEdgeBatch / 4, pixels_.size());
    directions_.clear();
    for (size_t k = first; k < last; ++k) {
      const auto column = pixels_[k] % width, row = pixels_[k] / width;
      for (const auto& [right, down] : kSamples)
        add_ray(static_cast<double>(column) + right, static_cast<double>(row) + down, R_world_cam);
    }
    look(origin, light, scene);
    for (size_t k = first; k < last; ++k) {
      const float* const four = &radiance_[4 * (k - first)];
      image_[pixels_[k]] = (four[0] + four[1] + four[2] + four[3]) / 4;
    }
  }
}

GrayImage Camera::picture(int frame, const Pose& T_world_velo, const Light& light,
                          RayCaster& scene) {
  const Pose T_world_cam = T_world_velo * model_.T_velo_cam;
  const Vec3 origin = T_world_cam.translation().cast<float>();
  const Eigen::Matrix3f R_world_cam = T_world_cam.linear().cast<float>();
  for (int top = 0; top < model_.height; top += kBand) {
    directions_.clear(), pixels_.clear();
    const int bottom = std::min(top + kBand, model_.height);
    for (int tile_row = top; tile_row < bottom; tile_row += kRayTile)
      for (int tile_column = 0; tile_column < model_.width; tile_column += kRayTile)
        for (int row = tile_row; row < std::min(tile_row + kRayTile, bottom); ++row)
          for (int column = tile_column; column < std::min(tile_column + kRayTile, model_.width);
               ++column) {
            add_ray(column, row, R_world_cam);
            pixels_.push_back(static_cast<uint32_t>(row * model_.width + column));
          }
    look(origin, light, scene);
    for (size_t i = 0; i < pixels_.size(); ++i) image_[pixels_[i]] = radiance_[i];
  }
  smooth_edges(origin, R_world_cam, light, scene);
  return develop(image_, model_.width, model_.height, light.exposure_error,
                 random_bits(seed_, 0x66696c6d, static_cast<uint64_t>(frame)));
}

Light light_at(uint64_t seed, double time, bool changing) {
  Random random(seed, 0x6c69676874);
  const double start = random.uniform(0, 2 * std::numbers::pi);
  const double phase = random.uniform(0, 2 * std::numbers::pi);
  const double t = changing ? time : 0;
  const double azimuth = start + kTurnRate * t;
  const double elevation =
      (35 + 20 * std::sin(phase + 2 * std::numbers::pi * t / kSwingPeriod)) * kDegree;
  // Mostly sunny or mostly overcast, seldom in between.
  const double cover =
      changing ? std::clamp((value_noise(seed ^ 0x636c6f7564, t, 0, kCloudSeconds) - 0.5) * 6 + 0.4,
                            0.0, 1.0)
               : 0;
  Light light;
  light.to_sun = Eigen::Vector3d(std::cos(azimuth) * std::cos(elevation),
                                 std::sin(azimuth) * std::cos(elevation), std::sin(elevation))
                     .cast<float>();
  light.sun = static_cast<float>(1 - 0.92 * cover);
  light.sky = static_cast<float>(0.2 + 0.15 * cover);
  if (changing)
    light.exposure_error = static_cast<float>(
        kExposureStops * (2 * value_noise(seed ^ 0x65787073, t, 0, kExposureSeconds) - 1));
  light.wind = {static_cast<float>(0.002 * t), static_cast<float>(0.001 * t)};
  return light;
}

float haze_radiance(const Light& light) {
  return 0.75f * (light.sky + 0.2f * light.sun) / std::numbers::pi_v<float>;
}

float sky_radiance(const Light& light, const Eigen::Vector3f& direction, const Textures& textures) {
  const float mean = light.sky / std::numbers::pi_v<float>;
  // Distant hills: their crest rises up to 2.5 degrees, in haze.
  const float azimuth = std::atan2(direction.y(), direction.x());
  const float crest = 0.022f * textures.noise.at(azimuth * 2.4f, 3.f, 0.05f);
  if (direction.z() < crest) return haze_radiance(light);
  const float up = std::max(direction.z(), 0.02f);
  const float gradient = 2.2f - 0.9f * up;  // brighter near the horizon
  const Eigen::Vector2f cloud = 0.6f * direction.head<2>() / (up + 0.15f) + 15 * light.wind;
  const float puffs = 0.75f + 0.35f * textures.noise.at(cloud.x(), cloud.y(), 0.01f / up);
  float glow = std::max(0.f, direction.dot(light.to_sun));
  for (int i = 0; i < 5; ++i) glow *= glow;  // to the power of 32
  return mean * gradient * puffs + 0.6f * light.sun * glow;
}

GrayImage develop(std::span<const float> radiance, int width, int height, float stops,
                  uint64_t noise_seed) {
  const auto metered = radiance.subspan(radiance.size() / 3);
  double sum = 0;
  for (const float r : metered) sum += static_cast<double>(r);
  const auto mean = static_cast<float>(sum / static_cast<double>(metered.size()));
  const float gain = kMeanExposure * std::exp2(stops) / std::max(mean, 1e-6f);

  std::array<uint8_t, 4096> curve;
  for (size_t i = 0; i < curve.size(); ++i)
    curve[i] = static_cast<uint8_t>(std::lround(
        255 *
        std::pow((static_cast<float>(i) + 0.5f) / static_cast<float>(curve.size()), 1 / kGamma)));
  GrayImage image{width, height, std::vector<uint8_t>(radiance.size())};
  for (size_t i = 0; i < radiance.size(); ++i) {
    const float signal = std::min(gain * radiance[i], 1.2f);
    const float sigma = std::sqrt(signal / kFullWell + kReadingNoise * kReadingNoise);
    const float seen = signal + sigma * normal_float(random_bits(noise_seed, i));
    const auto level = static_cast<int>(seen * static_cast<float>(curve.size()));
    image.pixels[i] =
        curve[static_cast<size_t>(std::clamp(level, 0, static_cast<int>(curve.size()) - 1))];
  }
  return image;
}

}  // namespace revisit::simulation
