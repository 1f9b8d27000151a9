#pragma once

#include <array>
#include <vector>

#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::pipeline::simulation {

/// Gentle hills, and a kerb and banks beside the road.
class Ground {
 public:
  Ground(uint64_t seed, const RoadMap& roads, const Scenery& scenery);

  /// Height of the hills, which is the height of the road surface [m]; slopes stay below 5 %.
  double height(const Eigen::Vector2d& point) const;
  /// Unit vector perpendicular to the hills.
  Eigen::Vector3d normal(const Eigen::Vector2d& point) const;
  /// Distance from the road's centre to the kerb there [m]: wider where cars park.
  double kerb(const Eigen::Vector2d& point) const;
  bool has_parking(const Eigen::Vector2d& point) const;
  /// Height of the surface with kerb, pavement and banks [m].
  double surface_height(const Eigen::Vector2d& point) const;

  /// The surface within `reach` metres of the path: fine near the road, coarse elsewhere.
  void build(const std::vector<PathPoint>& path, double reach, Mesh* mesh) const;

 private:
  struct Wave {
    Eigen::Vector2d k;  // wave vector [rad/m]
    double amplitude, phase;
  };
  /// Of the surface above the hills, so far beyond the kerb [m].
  double relief(const Eigen::Vector2d& point, double beyond) const;

  uint64_t seed_;
  const RoadMap& roads_;
  const Scenery& scenery_;
  double reach_;  // of what relief() needs to know, from the road [m]
  std::array<Wave, 6> waves_;
};

}  // namespace revisit::pipeline::simulation
