#pragma once

#include <span>

#include "revisit/recognition/point_cloud.h"
#include "revisit/recognition/ring/model.h"

namespace revisit::pipeline {

/// The polar ring of a levelled scan whose ground is at -sensor_height: `ring`
/// [grid.numbers()][sectors] and `seen` [grid.bins()][sectors], 1 for a bin that has a return or
/// that rays passed on their way to one behind it, else 0. Azimuth falls with the sector.
void polar_ring(const PointCloud& cloud, const RingGrid& grid, double sensor_height,
                std::span<float> ring, std::span<float> seen);

}  // namespace revisit::pipeline
