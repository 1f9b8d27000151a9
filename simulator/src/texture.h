#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace revisit::simulation {

/// Repeating square tile with mip levels: a pixel of any size gets the mean over its area.
class Texture {
 public:
  /// `value` is in [0, 2), for `size` x `size` texels of `texel` [m]; `size` must be a power of 2.
  Texture(int size, double texel, const std::function<double(int column, int row)>& value);

  /// Mean over a square of `footprint` meters around (u, v) [m].
  float at(float u, float v, float footprint) const;

 private:
  float bilinear(int level, float x, float y) const;  // in texels of the level

  int size_, levels_;
  float texel_;
  std::vector<uint8_t> texels_;  // level by level, 128 is 1
  std::vector<size_t> first_;    // [level]
};

/// Tiles of all towns. Values are factors around 1.
struct Textures {
  Textures();
  Texture noise;  // smooth, all wavelengths from 12 cm to 5 m
  Texture plaster, brick, stone, boards;
  Texture asphalt, slabs, lawn;
  Texture roof_tiles, bark, leaves;
};

}  // namespace revisit::simulation
