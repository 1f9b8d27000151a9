#pragma once

#include <filesystem>
#include <utility>
#include <vector>

#include "drive.h"
#include "ground.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"
#include "scenery.h"
#include "world.h"

namespace revisit::simulation {

/// Neither copied nor moved: its parts refer to each other.
struct Streets {
  const Scenery& scenery;
  std::vector<PlanarPose> poses;
  Path path;
  RoadMap roads;
  Ground ground;

  Streets(std::vector<PlanarPose> route, uint64_t seed, const std::string& surroundings = "town")
      : scenery(scenery_of(surroundings)),
        poses(std::move(route)),
        path(resample(poses)),
        roads(poses, path.points, scenery.oncoming),
        ground(seed, roads, scenery) {}
  Streets(const Streets&) = delete;
  Streets& operator=(const Streets&) = delete;

  World built(uint64_t seed) const {
    return build_world(seed, path.points, roads, ground, scenery);
  }
};

struct Town {
  Drive drive;
  Streets streets;
  World world;

  explicit Town(const SimulationConfig& config)
      : drive(make_drive(config)),
        streets(drive.poses, config.seed, config.surroundings),
        world(streets.built(config.seed)) {}
};

inline SimulationConfig quick(const std::filesystem::path& output) {
  SimulationConfig config;
  config.output = output;
  config.sensor = "vlp16";
  config.length = 400;
  config.last_frame = 5;
  config.threads = 1;
  return config;
}

}  // namespace revisit::simulation
