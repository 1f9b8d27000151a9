#pragma once

#include <cstddef>
#include <span>

namespace revisit {

/// Layout of the points in a headerless .bin file: x, y, z, then other values.
struct BinLayout {
  size_t numbers = 4;  // values per point
  bool doubles = false;
  size_t bytes() const { return numbers * (doubles ? 8 : 4); }
};

double number_at(std::span<const std::byte> content, const BinLayout& layout, size_t point,
                 size_t column);

/// Detects the layout of a file: 3 to 6 float32 or float64 values per point. Values of one kind
/// (heights, intensities, channels) have similar magnitudes. Only under the correct layout do
/// magnitudes vary less within a column than over all values. Returns KITTI's layout if the content
/// is ambiguous.
BinLayout find_bin_layout(std::span<const std::byte> content);

}  // namespace revisit
