#pragma once

#include <array>
#include <string>

#include "objects.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"
#include "site.h"

namespace revisit::simulation {

struct Range {
  double low = 0, high = 0;
};
struct Count {
  int low = 0, high = 0;
};

using Fences = std::array<FenceKind, 6>;

/// A fence or hedge along the road, wherever the ground is free.
struct RoadsideLine {
  double beyond_kerb = 0;  // [m], of its middle
  double below = 0;        // it exists where a smooth random field in [0, 1] is below this
  double owner = 25;       // [m], length scale of its height and gaps
  double kinds_an_owner = 6;
  Fences kinds = {};
  Range height = {};       // [m]
  bool left_only = false;  // in the central reservation
  bool joined = true;      // no gaps on the outside of a bend; built once for all passes
};

constexpr double kNever = 9, kAlways = -9;  // random fields are in [-0.2, 1.2]

/// Parameters of surroundings; the defaults are a town's. Lengths are in meters, fractions and
/// chances in [0, 1]. "By density": a chance where a smooth random field is 0 and where it is 1.
struct Scenery {
  const char* name = "";
  bool equal = false;  // all lots and roadside objects use the same random numbers

  double oncoming = kOncomingOffset;        // from the driven path to the left
  Range kerb = {3.5, 5.6};                  // from the lane's center: without and with a lay-by
  double kerb_height = 0.12, paving = 1.9;  // paving: width of the pavement
  bool asphalt = false;
  double bank_height = 0;           // maximum height of dams and cuttings
  Range bank = {0, 1};              // beyond the kerb: foot and top
  Range side_streets = {120, 280};  // spacing of side streets; 0: none
  Range side_street_width = {5, 8};

  double front = 1.4;  // beyond the kerb
  // By density: no lot below, a garden below, a terraced house above.
  double open_below = kAlways, green_below = 0.2, urban_above = 0.6;
  double smallest_width = 7.5, smallest_depth = 11;  // lot with a house
  Range urban_width = {8, 19}, green_width = {14, 28}, villa_width = {13, 22};
  Range urban_depth = {12, 16}, other_depth = {15, 23};
  double gapless = 0.8;  // chance that a terraced house touches the next one
  Count urban_floors = {2, 5}, villa_floors = {1, 3};
  double recessed = 0.3, shops = 0.3;           // chances, for terraced houses
  Range setback = {2.2, 5.5}, beside = {2, 7};  // villas: to the front, free width beside
  Fences fences = {};                           // tall fences
  double tall_fences = 0.6;
  double closed = 0.9;  // chance of a fence between a villa and the next
  Count plants_before = {2, 8}, plants_behind = {2, 6};  // per villa
  std::array<RoadsideLine, 3> lines = {};

  // On the pavement or verge.
  double verge = 0.75;                                                    // beyond the kerb
  Range things = {6, 15};                                                 // spacing
  double boards = 0, posts = 0, lamps = 0.28, signs = 0.2, trees = 0.27;  // else furniture
  Range parked = {0.2, 0.8};        // chance, by density, of a car in a lay-by
  std::array<double, 4> rows = {};  // rows of adjacent cars, distance beyond the kerb; 0: none
  Range row_cars = {};              // chance, by density, of a car in such a row

  double wood_above = kNever;       // threshold of another such field: dense trees
  Range wood = {};                  // beyond the kerb
  Range far_houses = {0.25, 0.85};  // chance, by density
  Count far_floors = {1, 4}, far_plants = {2, 8};
  double far_trees = 0.6;  // fraction of trees among the plants

  double oncoming_spacing = 90;    // 0: no oncoming cars
  Range oncoming_speed = {6, 11};  // [m/s]
  double leader = 0.4;             // chance that a car drives ahead
  size_t trucks = 0;               // among the 12 models

  Site (*site)(uint64_t seed) = nullptr;  // off the street, where all above is without meaning
  double sensor_height = kSensorHeight;   // usual one [m]
};

/// Throws UsageError unless it is a value of SimulationConfig::surroundings.
const Scenery& scenery_of(const std::string& surroundings);

}  // namespace revisit::simulation
