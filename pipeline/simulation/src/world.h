#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::pipeline::simulation {

/// Everything that does not move.
struct World {
  Mesh mesh;  // ground first, then the objects
  size_t ground_triangles = 0;
  std::vector<Footprint> objects;  // where the objects stand
};

/// Farther than any sensor sees: the ground reaches this far from the path [m].
constexpr double kWorldReach = 125;

/// Lays out surroundings in one walk along the path. Ground that is taken stays taken, so a street
/// driven twice gets its houses once.
World build_world(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
                  const Ground& ground, const Scenery& scenery);

}  // namespace revisit::pipeline::simulation
