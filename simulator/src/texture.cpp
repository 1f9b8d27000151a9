#include "texture.h"

#include <algorithm>
#include <cmath>

namespace revisit::simulation {
Texture::Texture(int size, double texel, const std::function<double(int, int)>& value)
    : size_(size), levels_(1), texel_(static_cast<float>(texel)) {
  std::vector<double> level(static_cast<size_t>(size) * static_cast<size_t>(size));
  for (int row = 0; row < size; ++row)
    for (int column = 0; column < size; ++column)
      level[static_cast<size_t>(row) * static_cast<size_t>(size) + static_cast<size_t>(column)] =
          value(column, row);
  for (auto side = static_cast<size_t>(size);; ++levels_) {
    first_.push_back(texels_.size());
    for (const double v : level)
      texels_.push_back(static_cast<uint8_t>(std::clamp(std::lround(v * 128), 0L, 255L)));
    if (side == 1) break;
    side /= 2;
    std::vector<double> half(side * side);
    for (size_t i = 0; i < side; ++i)
      for (size_t j = 0; j < side; ++j) {
        const size_t from = 4 * i * side + 2 * j;
        half[i * side + j] =
            (level[from] + level[from + 1] + level[from + 2 * side] + level[from + 2 * side + 1]) /
            4;
      }
    level = std::move(half);
  }
}

float Texture::bilinear(int level, float x, float y) const {
  const int mask = (size_ >> level) - 1;
  x -= 0.5f, y -= 0.5f;
  // Computes the integer part without floor(), for values within 2^30 texels.
  const auto floor_of = [](float z) {
    const int whole = static_cast<int>(z);
    return whole - (static_cast<float>(whole) > z);
  };
  const int i = floor_of(x), j = floor_of(y);
  const int i0 = i & mask, i1 = (i + 1) & mask, j0 = j & mask, j1 = (j + 1) & mask;
  const uint8_t* const texels = texels_.data() + first_[static_cast<size_t>(level)];
  const auto texel = [&](int column, int row) {
    return static_cast<float>(texels[static_cast<size_t>(row) * static_cast<size_t>(mask + 1) +
                                     static_cast<size_t>(column)]);
  };
  const float a = x - static_cast<float>(i), b = y - static_cast<float>(j);
  return (1 - b) * ((1 - a) * texel(i0, j0) + a * texel(i1, j0)) +
         b * ((1 - a) * texel(i0, j1) + a * texel(i1, j1));
}

float Texture::at(float u, float v, float footprint) const {
  const auto coarsest = static_cast<float>(levels_ - 1);
  const float lod = std::clamp(std::log2(std::max(footprint, 1e-6f) / texel_), 0.f, coarsest);
  const int level = std::min(static_cast<int>(lod), levels_ - 2);
  const float scale = 1 / (texel_ * static_cast<float>(1 << level));
  const float x = u * scale, y = v * scale, blend = lod - static_cast<float>(level);
  const float fine = bilinear(level, x, y);
  if (blend <= 0) return fine / 128;
  return (fine + blend * (bilinear(level + 1, x / 2, y / 2) - fine)) / 128;
}

}  // namespace revisit::simulation
