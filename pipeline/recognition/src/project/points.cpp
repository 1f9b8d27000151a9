#include "revisit/recognition/points.h"

#include <algorithm>
#include <cstring>

#include "revisit/base/error.h"

namespace revisit {

void copy_points(const PointsView& points, PointCloud& cloud) {
  const size_t last = std::max({points.x, points.y, points.z}) + sizeof(float);
  if (points.stride < last)
    throw UsageError("points: expected a stride of at least ", last,
                     " bytes for the coordinates, found ", points.stride);
  if (!points.data && points.count > 0)
    throw UsageError("points: ", points.count, " points without data");
  cloud.points.resize(points.count);
  cloud.times.clear();
  if (!points.data) return;
  const auto* from = static_cast<const std::byte*>(points.data);
  for (Point& point : cloud.points) {
    std::memcpy(&point.x, from + points.x, sizeof(float));  // may be unaligned
    std::memcpy(&point.y, from + points.y, sizeof(float));
    std::memcpy(&point.z, from + points.z, sizeof(float));
    point.intensity = 0;
    from += points.stride;
  }
}

}  // namespace revisit
