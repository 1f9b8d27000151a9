#include "film.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace revisit::simulation {
namespace {

constexpr float kMeanExposure = 0.22f;    // fraction of saturation
constexpr float kFullWell = 6000;         // photons at saturation
constexpr float kReadingNoise = 0.0025f;  // fraction of saturation
constexpr float kGamma = 1.8f;

}  // namespace

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
