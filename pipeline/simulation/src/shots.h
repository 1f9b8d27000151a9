#pragma once

#include <vector>

#include "ground.h"
#include "revisit/datasets/pose.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

/// One scan of a place.
struct Shot {
  int place = 0;   // from 0
  int number = 0;  // at the place
  Pose T_town_velo;
  size_t path_point = 0;  // beside which the tripod stands
};

constexpr int kPlaces = 7;
/// Length of the route (RouteKind::kLoop) along whose first round the places are [m].
constexpr double kPlaceRoute = 1600;
constexpr double kTripodHeight = 1.5;  // of the sensor above the ground [m]
/// The sensor is nowhere farther than this from the middle of its place [m].
constexpr double kPlaceRadius = 0.5;

/// How many scans each place gets: 77 or 94 in all, as in the HKUST data.
std::vector<int> shots_per_place(PlaceScans scans);

/// The shots place by place. The places are the same for both kinds.
std::vector<Shot> plan_shots(PlaceScans scans, uint64_t seed, const std::vector<PathPoint>& path,
                             const Ground& ground);

}  // namespace revisit::pipeline::simulation
