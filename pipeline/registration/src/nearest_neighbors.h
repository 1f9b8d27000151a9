#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace revisit {

struct Neighbor {
  float squared = 0;  // [m^2]
  uint32_t point = 0;
};

/// Queries are thread-safe.
class NearestNeighbors {
 public:
  /// `points` are not copied and must not move or change.
  explicit NearestNeighbors(const std::vector<Eigen::Vector3f>& points);
  ~NearestNeighbors();

  /// Fills `found`, nearest first, with squared distances below `limit` [m^2]. Returns their
  /// number.
  size_t nearest(const Eigen::Vector3f& place, float limit, std::span<Neighbor> found) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace revisit
