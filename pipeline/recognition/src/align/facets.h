#pragma once

#include <optional>

#include "align/ground.h"

namespace revisit {

/// Finds the direction to which flat patches within 20 m are perpendicular (floor, ceiling) or
/// parallel (walls), at most 30 degrees from z. Without a floor below, the height is
/// `sensor_height` [m]. Returns nothing if there are fewer than 20 patches, or if less than 40 % of
/// their weight agrees.
std::optional<Ground> find_upright(const PointCloud& cloud, double sensor_height);

}  // namespace revisit
