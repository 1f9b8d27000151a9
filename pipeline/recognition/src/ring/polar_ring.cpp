#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "ring/extraction.h"

namespace revisit {

void polar_ring(const PointCloud& cloud, const RingGrid& grid, double sensor_height,
                std::span<float> ring, std::span<float> seen) {
  constexpr float kEmpty = std::numeric_limits<float>::lowest();
  constexpr double kTurn = 2 * std::numbers::pi;
  const int bins = grid.bins(), sectors = grid.sectors;
  const std::span<float> highest = ring.first(seen.size()), bands = ring.subspan(seen.size());
  std::ranges::fill(highest, kEmpty);
  std::ranges::fill(bands, 0.0F);
  std::ranges::fill(seen, 0.0F);
  std::vector<int> reached(static_cast<size_t>(sectors),
                           0);  // [sector], bins reached
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const double azimuth = std::atan2(point.y, point.x);
    const double around = (azimuth < 0 ? azimuth + kTurn : azimuth) / kTurn;
    const int sector = sectors - 1 - std::min(static_cast<int>(around * sectors), sectors - 1);
    const auto next = std::ranges::upper_bound(
        grid.distances, std::sqrt(double{point.x} * point.x + double{point.y} * point.y));
    const auto bin = static_cast<int>(next - grid.distances.begin()) - 1;
    int& far = reached[static_cast<size_t>(sector)];
    far = std::max(far, std::min(bin + 1, bins));
    if (bin < 0 || bin == bins) continue;
    const size_t at = static_cast<size_t>(bin) * sectors + sector;
    const double height = point.z + sensor_height;
    highest[at] = std::max(highest[at], static_cast<float>(height));
    const auto band = std::ranges::upper_bound(grid.bands, height) - grid.bands.begin();
    if (band > 0) bands[static_cast<size_t>(band - 1) * seen.size() + at] = 1;
  }
  std::ranges::replace(highest, kEmpty, 0.0F);
  for (int sector = 0; sector < sectors; ++sector)
    for (int bin = 0; bin < reached[static_cast<size_t>(sector)]; ++bin)
      seen[static_cast<size_t>(bin) * sectors + sector] = 1;
}

}  // namespace revisit
