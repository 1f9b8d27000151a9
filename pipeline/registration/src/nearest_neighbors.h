#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace revisit {

struct Neighbor {
  float squared = 0;  // [m^2]
  uint32_t point = 0;
};

/// Points sorted by the squares of a top-down grid, row by row.
struct PointSquares {
  float edge = 1, per_meter = 1;  // [m], [1/m]
  Eigen::Vector3f least;
  int rows = 1, columns = 1;
  std::vector<uint32_t> starts;                    // [row][column], and the number of points
  Eigen::Matrix<float, Eigen::Dynamic, 3> sorted;  // and a vector's, which are nowhere
  std::vector<uint32_t> order;                     // [sorted] -> point

  /// Number of squares from `first` to `x`, 0 to `count` - 1.
  int steps(float x, float first, int count) const {
    const float step = (x - first) * per_meter;
    if (!(step > 0)) return 0;
    return step < static_cast<float>(count) ? static_cast<int>(step) : count - 1;
  }
};

/// A search compares a few runs of consecutive points. Surfaces have few points a square, so this
/// takes less than half of a k-d tree's time. Queries are thread-safe.
class NearestNeighbors {
 public:
  /// `square`: edge of a square [m]. At least one point.
  NearestNeighbors(const std::vector<Eigen::Vector3f>& points, float square);

  /// Fills `found`, nearest first, with squared distances below `limit` [m^2]. Returns their
  /// number.
  size_t nearest(const Eigen::Vector3f& place, float limit, std::span<Neighbor> found) const;

 private:
  PointSquares squares_;
};

}  // namespace revisit
