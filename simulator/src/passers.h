#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"

namespace revisit::simulation {

struct Passers {
  Mesh mesh;
  int people = 0, cars = 0;
};

/// Places one to four people within 9 m of the sensor. Places up to two cars on the two lanes
/// within 20 m of path point `here`. People and cars do not collide with `objects`, the sensor or
/// each other. Depends only on `seed`, the town and the sensor's position.
Passers make_passers(uint64_t seed, const std::vector<PathPoint>& path, size_t here,
                     const Eigen::Vector2d& sensor, const Ground& ground,
                     const std::vector<Footprint>& objects);

}  // namespace revisit::simulation
