#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace revisit::pipeline {

struct Neighbour {
  float squared = 0;  // distance [m^2]
  uint32_t point = 0;
};

/// The points nearest to a place. May be asked by several threads at once.
class Neighbours {
 public:
  /// `points` are not copied: they must stay as and where they are.
  explicit Neighbours(const std::vector<Eigen::Vector3f>& points);
  ~Neighbours();

  /// Writes the nearest points, nearest first, into `found`: those whose squared distance is below
  /// `limit`, as many as there is space for. Returns their number.
  size_t nearest(const Eigen::Vector3f& place, float limit, std::span<Neighbour> found) const;

 private:
  struct Tree;
  std::unique_ptr<const Tree> tree_;
};

}  // namespace revisit::pipeline
