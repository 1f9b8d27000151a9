#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

/// People and cars that pass a sensor that stands still.
struct Passers {
  Mesh mesh;
  int people = 0, cars = 0;
};

/// One to four people within 9 m of the sensor and up to two cars on the two lanes within 20 m of
/// point `here` of the path. They keep clear of `objects`, the sensor and each other. Depends on
/// `seed`, the town and where the sensor is only.
Passers make_passers(uint64_t seed, const std::vector<PathPoint>& path, size_t here,
                     const Eigen::Vector2d& sensor, const Ground& ground,
                     const std::vector<Footprint>& objects);

}  // namespace revisit::pipeline::simulation
