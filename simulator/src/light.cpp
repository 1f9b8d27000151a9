#include "light.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "degree.h"
#include "random.h"

namespace revisit::simulation {
namespace {

constexpr double kTurnRate = 0.25 * kDegree;  // 15 degrees per hour, an hour per minute [rad/s]
constexpr double kSwingPeriod = 1440;         // period of the sun's elevation [s]
constexpr double kCloudSeconds = 35, kExposureSeconds = 20;
constexpr double kExposureStops = 0.5;

}  // namespace

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

}  // namespace revisit::simulation
