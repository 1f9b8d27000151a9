#pragma once

#include <array>
#include <vector>

#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::simulation {

class Ground {
 public:
  Ground(uint64_t seed, const RoadMap& roads, const Scenery& scenery);

  /// Returns the height of the hills, which is that of the road surface [m]; slopes stay below 5 %.
  double height(const Eigen::Vector2d& point) const;
  Eigen::Vector3d normal(const Eigen::Vector2d& point) const;
  /// Returns the distance from the road's center to the kerb [m]; it is larger where cars park.
  double kerb(const Eigen::Vector2d& point) const;
  bool has_parking(const Eigen::Vector2d& point) const;
  /// Returns the height of the surface with kerb, pavement and banks [m].
  double surface_height(const Eigen::Vector2d& point) const;

  /// Adds the surface within `reach` meters of the path: fine near the road, coarse elsewhere.
  void build(const std::vector<PathPoint>& path, double reach, Mesh* mesh) const;

 private:
  struct Wave {
    Eigen::Vector2d k;  // wave vector [rad/m]
    double amplitude, phase;
  };
  /// Returns the surface height above the hills, `beyond` meters beyond the kerb [m].
  double relief(const Eigen::Vector2d& point, double beyond) const;

  uint64_t seed_;
  const RoadMap& roads_;
  const Scenery& scenery_;
  double reach_;  // [m], distance from the road up to which relief() is not constant
  std::array<Wave, 6> waves_;
};

}  // namespace revisit::simulation
