#pragma once

#include <vector>

#include "ground.h"
#include "revisit/datasets/dataset.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::simulation {

struct Shot {
  int place = 0;
  int number = 0;  // index at the place
  Pose T_town_velo;
  size_t path_point = 0;  // nearest path point to the tripod
};

constexpr int kPlaces = 7;
constexpr double kPlaceRoute = 1600;   // [m] route "loop"; its first round has the places
constexpr double kTripodHeight = 1.5;  // [m] sensor above the ground
constexpr double kPlaceRadius = 0.5;   // [m] from the middle of a place to the sensor

/// Returns the number of scans per place: 77, or 94 with passing objects, as in the HKUST data.
std::vector<int> shots_per_place(bool objects);

/// Both kinds of scans have the same places.
std::vector<Shot> plan_shots(bool objects, uint64_t seed, const std::vector<PathPoint>& path,
                             const Ground& ground);

}  // namespace revisit::simulation
