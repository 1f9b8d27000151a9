#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace revisit {

struct Neighbor {
  float squared = 0;  // [m^2]
  uint32_t point = 0;
};

/// Points sorted by the squares of a top-down grid, row by row: a search compares a few runs of
/// consecutive points. Surfaces have few points a square, so this takes less than half of a k-d
/// tree's time. Queries are thread-safe.
class NearestNeighbors {
 public:
  /// `square`: edge of a square [m]. At least one point.
  NearestNeighbors(const std::vector<Eigen::Vector3f>& points, float square);

  /// Fills `found`, nearest first, with squared distances below `limit` [m^2]. Returns their
  /// number.
  size_t nearest(const Eigen::Vector3f& place, float limit, std::span<Neighbor> found) const;

  /// True if a point is nearer than a squared distance of `limit` [m^2].
  bool any_within(const Eigen::Vector3f& place, float limit) const;

 private:
  /// Number of squares from `least` to `x`, 0 to `count` - 1.
  int steps(float x, float least, int count) const {
    const float step = (x - least) * per_meter_;
    if (!(step > 0)) return 0;
    return step < static_cast<float>(count) ? static_cast<int>(step) : count - 1;
  }
  /// take(squared distance, position in the sorted points) of points below `limit`, which it may
  /// lower; false ends the search.
  template <class Take>
  void search(const Eigen::Vector3f& place, float& limit, const Take& take) const;
  template <class Take>
  bool search_run(uint32_t begin, uint32_t end, const Eigen::Vector3f& place, float& limit,
                  const Take& take) const;

  float square_, per_meter_;
  Eigen::Vector3f least_;
  int rows_ = 1, columns_ = 1;
  std::vector<uint32_t> starts_;                    // [row][column], and the number of points
  Eigen::Matrix<float, Eigen::Dynamic, 3> sorted_;  // and kLanes - 1 that are nowhere
  std::vector<uint32_t> order_;                     // [sorted] -> point
};

}  // namespace revisit
