#pragma once

#include <span>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// A polar grid on the ground plane, the sensor in its middle.
struct PolarGrid {
  int rings = 20, sectors = 60;
  double max_range = 80;     // [m]: points farther on the ground plane are left out
  double sensor_height = 2;  // [m], added to z so that the ground is about 0
};

/// Heights of the highest points of each bin, `[rings][sectors]` [m], 0 where there is none (G.
/// Kim, A. Kim: Scan Context, IROS 2018). Ring 0 is nearest; sector 0 begins at azimuth 0 (x) and
/// azimuth grows with the sector (counter-clockwise): a yaw of the cloud by +360/sectors deg moves
/// every column one to the right, around the edge.
void polar_heights(const PointCloud& cloud, const PolarGrid& grid, std::span<float> heights);

}  // namespace revisit::pipeline
