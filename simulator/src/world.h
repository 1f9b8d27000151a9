#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::simulation {

struct World {
  Mesh mesh;  // ground first, then the objects
  size_t ground_triangles = 0;
  std::vector<Footprint> objects;
};

constexpr double kWorldReach = 125;  // [m] from the path; beyond the range of any sensor

/// Occupied ground stays occupied, so that a street driven twice gets its houses once.
World build_world(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
                  const Ground& ground, const Scenery& scenery);

}  // namespace revisit::simulation
