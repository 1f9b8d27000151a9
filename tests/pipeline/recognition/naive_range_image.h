#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "revisit/recognition/range_image.h"

/// References for range_image.h.
namespace revisit {

/// Largest effect of float rounding on a pixel of 0..255.
inline constexpr float kRounding = 2e-5F;

inline int count_differing(const RangeImage& a, const RangeImage& b, float tolerance) {
  EXPECT_EQ(a.pixels.size(), b.pixels.size());
  int differing = 0;
  for (size_t i = 0; i < a.pixels.size(); ++i)
    differing +=
        std::abs(a.pixels[i] - b.pixels[i]) > tolerance || (a.pixels[i] == 0) != (b.pixels[i] == 0);
  return differing;
}

/// The documented formula, in double.
inline RangeImage project_naively(const PointCloud& cloud, const ImageGeometry& g) {
  RangeImage image{g.width, g.height, std::vector<float>(static_cast<size_t>(g.width) * g.height)};
  constexpr double kPi = std::numbers::pi;
  for (const Point& p : cloud.points) {
    if (!is_return(p)) continue;
    const double x = p.x, y = p.y, z = p.z, range = std::sqrt(x * x + y * y + z * z);
    const double azimuth = std::atan2(y, x), elevation = std::asin(z / range) * 180 / kPi;
    const int column =
        static_cast<int>(std::floor((kPi - azimuth) / (2 * kPi) * g.width)) % g.width;
    const double row = std::floor((g.elevation_top - elevation) /
                                  (g.elevation_top - g.elevation_bottom) * g.height);
    if (row < 0 || row >= g.height) continue;
    float& pixel = image.pixels[static_cast<size_t>(row) * g.width + column];
    const auto value = static_cast<float>(255 * std::min(range, g.max_range) / g.max_range);
    if (pixel == 0 || value < pixel) pixel = value;
  }
  return image;
}

inline PointCloud random_cloud(unsigned seed, int count) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> ground(-50, 50), height(-15, 15);
  PointCloud cloud;
  for (int i = 0; i < count; ++i)
    cloud.points.push_back({ground(random), ground(random), height(random), 0});
  return cloud;
}

/// Dilation (or erosion) by its definition: the extreme of the pixels under the rectangle.
template <class Extreme>
RangeImage morphology(const RangeImage& image, int width, int height, Extreme extreme) {
  RangeImage result = image;
  for (int row = 0; row < image.height; ++row)
    for (int column = 0; column < image.width; ++column) {
      float value = image.at(row, column);
      for (int dr = -height / 2; dr <= height / 2; ++dr)
        for (int dc = -width / 2; dc <= width / 2; ++dc)
          if (row + dr >= 0 && row + dr < image.height)
            value =
                extreme(value, image.at(row + dr, (column + dc + 2 * image.width) % image.width));
      result.pixels[static_cast<size_t>(row) * image.width + column] = value;
    }
  return result;
}

inline RangeImage close_naively(const RangeImage& image, int width, int height) {
  const auto max = [](float a, float b) { return std::max(a, b); };
  const auto min = [](float a, float b) { return std::min(a, b); };
  return morphology(morphology(image, width, height, max), width, height, min);
}

inline RangeImage sparse_image(int width, int height) {
  std::mt19937 random(static_cast<unsigned>(width * 1000 + height));
  std::uniform_real_distribution<float> value(0, 255);
  RangeImage image{width, height, {}};
  for (int i = 0; i < width * height; ++i) image.pixels.push_back(random() % 4 ? 0 : value(random));
  return image;
}

}  // namespace revisit
