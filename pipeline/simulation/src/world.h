#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::pipeline::simulation {

struct World {
  Mesh mesh;  // ground first, then the objects
  size_t ground_triangles = 0;
  std::vector<Footprint> objects;  // footprints of the objects
};

/// Distance of the ground's edge from the path, beyond the range of any sensor [m].
constexpr double kWorldReach = 125;

/// Builds surroundings in one walk along the path. Occupied ground stays occupied, so a street
/// driven twice gets its houses once.
World build_world(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
                  const Ground& ground, const Scenery& scenery);

}  // namespace revisit::pipeline::simulation
