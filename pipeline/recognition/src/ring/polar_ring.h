#pragma once

#include <span>

#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/ring/model.h"

namespace revisit {

/// Computes the polar ring of a gravity-aligned scan whose ground is at -sensor_height: `ring`
/// [grid.numbers()][sectors] and `seen` [grid.bins()][sectors]. A bin is seen (1, else 0) if it has
/// a return or a ray passed it. Azimuth decreases with the sector.
void polar_ring(const PointCloud& cloud, const RingGrid& grid, double sensor_height,
                std::span<float> ring, std::span<float> seen);

}  // namespace revisit
