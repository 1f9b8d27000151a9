#include "texture.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "random.h"

namespace revisit::simulation {

namespace {

using TexelValue = std::function<double(int column, int row)>;

constexpr int kSize = 512;

/// In [0, 1): values on a lattice of cells that divide the tile, blended by smoothstep.
class TiledNoise {
 public:
  TiledNoise(uint64_t seed, int cell_width, int cell_height)
      : width_(cell_width), height_(cell_height), columns_(kSize / cell_width) {
    for (int row = 0; row < kSize / cell_height; ++row)
      for (int column = 0; column < columns_; ++column)
        lattice_.push_back(unit_float(
            random_bits(seed, static_cast<uint64_t>(column), static_cast<uint64_t>(row))));
  }
  double operator()(int x, int y) const {
    const int i = x / width_, j = y / height_, rows = kSize / height_;
    const int right = (i + 1) % columns_, above = (j + 1) % rows;
    const auto at = [&](int column, int row) {
      return static_cast<double>(lattice_[static_cast<size_t>(row) * static_cast<size_t>(columns_) +
                                          static_cast<size_t>(column)]);
    };
    const auto smooth = [](int part, int whole) {
      const double t = static_cast<double>(part) / whole;
      return t * t * (3 - 2 * t);
    };
    const double a = smooth(x % width_, width_), b = smooth(y % height_, height_);
    return (1 - b) * ((1 - a) * at(i, j) + a * at(right, j)) +
           b * ((1 - a) * at(i, above) + a * at(right, above));
  }

 private:
  int width_, height_, columns_;
  std::vector<float> lattice_;  // [row][column]
};

/// In [-1, 1]: octaves from `coarse` to `fine` texels; each weighs `decay` times the previous one.
class Fractal {
 public:
  Fractal(uint64_t seed, int coarse, int fine, double decay) : decay_(decay) {
    for (int cell = coarse; cell >= fine; cell /= 2)
      octaves_.emplace_back(seed + static_cast<uint64_t>(cell), cell, cell);
  }
  double operator()(int x, int y) const {
    double sum = 0, weights = 0, weight = 1;
    for (const TiledNoise& octave : octaves_) {
      sum += weight * (2 * octave(x, y) - 1);
      weights += weight;
      weight *= decay_;
    }
    return sum / weights;
  }

 private:
  double decay_;
  std::vector<TiledNoise> octaves_;
};

double shade(uint64_t seed, int column, int row) {
  return static_cast<double>(
      unit_float(random_bits(seed, static_cast<uint64_t>(column), static_cast<uint64_t>(row))));
}

struct Piece {
  int column, row;
  int x, y;  // texels from the lower left corner of the piece
};
Piece piece(int x, int y, int width, int height, bool bonded) {
  const int row = y / height;
  const int shifted = (x + (bonded && row % 2 ? width / 2 : 0)) % kSize;
  return {shifted / width, row, shifted % width, y % height};
}

TexelValue noise() {  // 3 cm a texel
  return [f = Fractal(1, 128, 4, 0.81)](int x, int y) { return 1 + 0.9 * f(x, y); };
}

TexelValue plaster() {  // 1 cm a texel: stains, and streaks that run down
  return [streaks = TiledNoise(41, 8, 128), stains = Fractal(42, 128, 2, 0.76)](int x, int y) {
    return 1 + 0.24 * stains(x, y) - 0.3 * std::max(0.0, streaks(x, y) - 0.6);
  };
}

TexelValue bricks() {  // 1 cm a texel: 32 x 8 cm with mortar
  return [grain = Fractal(12, 8, 2, 0.71)](int x, int y) {
    const Piece p = piece(x, y, 32, 8, true);
    return p.x < 1 || p.y < 1 ? 1.35
                              : 0.72 + 0.45 * shade(11, p.column, p.row) + 0.08 * grain(x, y);
  };
}

TexelValue stones() {  // 1 cm a texel: 64 x 32 cm, dark joints
  return [grain = Fractal(22, 64, 2, 0.66)](int x, int y) {
    const Piece p = piece(x, y, 64, 32, true);
    return p.x < 2 || p.y < 2 ? 0.55 : 0.8 + 0.35 * shade(21, p.column, p.row) + 0.15 * grain(x, y);
  };
}

TexelValue boards() {  // 1 cm a texel: boards of 16 cm, one above the other
  return [grain = TiledNoise(32, 64, 2)](int x, int y) {
    const Piece p = piece(x, y, kSize, 16, false);
    if (p.y < 2) return 0.5;
    return 0.79 + 0.01 * p.y + 0.12 * shade(31, 0, p.row) + 0.2 * grain(x, y);
  };
}

TexelValue gravel() {  // 1 cm a texel
  return [f = Fractal(53, 64, 1, 0.93)](int x, int y) { return 1 + 0.3 * f(x, y); };
}

TexelValue slabs() {  // 1 cm a texel: 32 x 32 cm
  return [grain = Fractal(62, 16, 2, 0.76)](int x, int y) {
    const Piece p = piece(x, y, 32, 32, false);
    return p.x < 1 || p.y < 1 ? 0.6 : 0.9 + 0.22 * shade(61, p.column, p.row) + 0.12 * grain(x, y);
  };
}

TexelValue grass() {  // 2 cm a texel
  return [f = Fractal(71, 128, 1, 0.87)](int x, int y) { return 1 + 0.55 * f(x, y); };
}

TexelValue roof_tiles() {  // 1 cm a texel: 16 cm wide, rows of 32 cm in each other's shadow
  return [](int x, int y) {
    const Piece p = piece(x, y, 16, 32, true);
    const double hollow = 0.12 * std::cos(2 * std::numbers::pi * p.x / 16);
    return (p.y < 4 ? 0.6 : 0.9) + hollow + 0.25 * shade(81, p.column, p.row);
  };
}

TexelValue bark() {  // 5 mm a texel: furrows
  return [furrows = TiledNoise(91, 8, 64), grain = Fractal(92, 16, 2, 0.81)](int x, int y) {
    return 0.65 + 0.7 * furrows(x, y) + 0.15 * grain(x, y);
  };
}

TexelValue foliage() {  // 5 mm a texel: leaves of 4 to 8 cm before their own shadow
  return [level = TiledNoise(101, 16, 8), upright = TiledNoise(102, 8, 16),
          grain = Fractal(103, 64, 4, 0.71)](int x, int y) {
    return 0.08 + 1.1 * std::max(level(x, y), upright(x, y)) + 0.2 * grain(x, y);
  };
}

}  // namespace

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

Textures::Textures()
    : noise(kSize, 0.03, simulation::noise()),
      plaster(kSize, 0.01, simulation::plaster()),
      brick(kSize, 0.01, bricks()),
      stone(kSize, 0.01, stones()),
      boards(kSize, 0.01, simulation::boards()),
      asphalt(kSize, 0.01, gravel()),
      slabs(kSize, 0.01, simulation::slabs()),
      lawn(kSize, 0.02, grass()),
      roof_tiles(kSize, 0.01, simulation::roof_tiles()),
      bark(kSize, 0.005, simulation::bark()),
      leaves(kSize, 0.005, foliage()) {}

}  // namespace revisit::simulation
