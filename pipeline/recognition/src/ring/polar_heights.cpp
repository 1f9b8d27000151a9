#include "revisit/recognition/polar_heights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace revisit::pipeline {

void polar_heights(const PointCloud& cloud, const PolarGrid& grid, std::span<float> heights) {
  constexpr float kEmpty = std::numeric_limits<float>::lowest();
  constexpr double kTurn = 2 * std::numbers::pi;
  std::ranges::fill(heights, kEmpty);
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const double range = std::hypot(double{point.x}, double{point.y});
    if (range > grid.max_range) continue;
    double azimuth = std::atan2(double{point.y}, double{point.x});
    if (azimuth < 0) azimuth += kTurn;
    const int ring =
        std::min(static_cast<int>(range / grid.max_range * grid.rings), grid.rings - 1);
    const int sector = std::min(static_cast<int>(azimuth / kTurn * grid.sectors), grid.sectors - 1);
    float& bin = heights[static_cast<size_t>(ring) * grid.sectors + sector];
    bin = std::max(bin, static_cast<float>(point.z + grid.sensor_height));
  }
  std::ranges::replace(heights, kEmpty, 0.0F);
}

}  // namespace revisit::pipeline
