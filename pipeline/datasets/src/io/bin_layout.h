#pragma once

#include <cstddef>
#include <span>

namespace revisit::pipeline {

/// How the points of a headerless .bin file lie in it: x, y, z, then others.
struct BinLayout {
  size_t numbers = 4;    // a point
  bool doubles = false;  // float64 instead of float32
  size_t bytes() const { return numbers * (doubles ? 8 : 4); }
};

/// Number `column` of point `point`.
double number_at(std::span<const std::byte> content, const BinLayout& layout, size_t point,
                 size_t column);

/// The layout of a file's content: 3 to 6 float32 or float64 a point. Numbers of one kind (heights,
/// intensities, rings) have magnitudes of their own: under the right layout, and no other, the
/// magnitudes within a column vary less than those of all numbers. KITTI's layout when the content
/// does not tell.
BinLayout find_bin_layout(std::span<const std::byte> content);

}  // namespace revisit::pipeline
