#pragma once

#include <vector>

#include "ground.h"
#include "mesh.h"
#include "road_map.h"
#include "scenery.h"

namespace revisit::simulation {

/// Poses of the vehicles depend only on the time.
class Traffic {
 public:
  /// `share` scales the usual number of vehicles.
  Traffic(uint64_t seed, const std::vector<PathPoint>& path, const Ground& ground,
          const Scenery& scenery, double share);

  /// Vehicles within `reach` meters of the ego vehicle at path point `ego`, at `time` [s].
  Mesh at(double time, size_t ego, double reach) const;

 private:
  struct Oncoming {
    double start, speed;  // position along the path [m], speed against it [m/s]
    size_t model;
  };
  void place(size_t model, double s, double to_left, bool against, const Eigen::Vector2d& ego,
             double reach, Mesh* mesh) const;

  uint64_t seed_;
  const std::vector<PathPoint>& path_;
  const Ground& ground_;
  const Scenery& scenery_;
  float leader_;  // chance
  std::vector<Mesh> models_;
  std::vector<Oncoming> oncoming_;
};

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
