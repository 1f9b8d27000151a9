#pragma once

#include <array>
#include <vector>

#include "mesh.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

/// The ground of the town: gentle hills, and a kerb beside the road.
class Ground {
 public:
  Ground(uint64_t seed, const RoadMap& roads);

  /// Height of the hills, which is the height of the road surface [m]; slopes stay below 5 %.
  double height(const Eigen::Vector2d& point) const;
  /// Unit vector perpendicular to the hills.
  Eigen::Vector3d normal(const Eigen::Vector2d& point) const;
  /// Distance from the road's centre to the kerb there [m]: wider where cars park.
  double kerb(const Eigen::Vector2d& point) const;
  bool has_parking(const Eigen::Vector2d& point) const;
  /// Height of the surface with kerb and pavement [m].
  double surface_height(const Eigen::Vector2d& point) const;

  /// The surface within `reach` metres of the path: fine near the road, coarse elsewhere.
  void build(const std::vector<PathPoint>& path, double reach, Mesh* mesh) const;

 private:
  struct Wave {
    Eigen::Vector2d k;  // wave vector [rad/m]
    double amplitude, phase;
  };
  uint64_t seed_;
  const RoadMap& roads_;
  std::array<Wave, 6> waves_;
};

}  // namespace revisit::pipeline::simulation
