#pragma once

#include <array>

#include "objects.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

struct Range {
  double low = 0, high = 0;
};
struct Count {
  int low = 0, high = 0;
};

/// As many as a die has sides: what a lot, or a piece of road, is closed by.
using Fences = std::array<FenceKind, 6>;

/// Something that stands along the road wherever the ground is still free.
struct RoadsideLine {
  double beyond_kerb = 0;  // its middle [m]
  double below = 0;        // it stands where a smooth random field in [0, 1] is less
  double owner = 25;       // its height varies and its gaps come over so many metres
  double kinds_an_owner = 6;
  Fences kinds = {};
  Range height = {};       // [m]
  bool left_only = false;  // between two carriageways
  bool joined = true;      // without gaps on the outside of a bend, and once for all passes
};

constexpr double kNever = 9, kAlways = -9;  // random fields are within [-0.2, 1.2]

/// What surroundings are made of; the numbers are a town's. Lengths are in metres, shares and
/// chances in [0, 1]. "By density": a chance where a smooth random field is 0 and where it is 1.
struct Scenery {
  const char* name = "";
  bool equal = false;  // lots and things along the road are built of the same random numbers

  // The road.
  double oncoming = kOncomingOffset;  // the lane of oncoming cars, to the left of the driven path
  Range kerb = {3.5, 5.6};            // from the lane's centre: without a lay-by, with one
  double kerb_height = 0.12, paving = 1.9;  // paving: width of the pavement
  bool asphalt = false;                     // all the ground is
  double bank_height = 0;                   // of dams and cuttings, at most
  Range bank = {0, 1};                      // beyond the kerb: its foot, its top
  Range side_streets = {120, 280};          // between streets that nobody drives; 0: none
  Range side_street_width = {5, 8};

  // Lots beside the road.
  double front = 1.4;  // beyond the kerb
  // By density: there is no lot, it is a garden, or a house in a row.
  double open_below = kAlways, green_below = 0.2, urban_above = 0.6;
  double smallest_width = 7.5, smallest_depth = 11;  // of a lot with a house
  Range urban_width = {8, 19}, green_width = {14, 28}, villa_width = {13, 22};
  Range urban_depth = {12, 16}, other_depth = {15, 23};
  double gapless = 0.8;  // chance that a house in a row touches the next one
  Count urban_floors = {2, 5}, villa_floors = {1, 3};
  double recessed = 0.3, shops = 0.3;           // chances, of houses in a row
  Range setback = {2.2, 5.5}, beside = {2, 7};  // of villas: from the front, free width
  Fences fences = {};                           // the tall ones
  double tall_fences = 0.6;                     // chance
  double closed = 0.9;                          // chance of a fence between a villa and the next
  Count plants_before = {2, 8}, plants_behind = {2, 6};  // of a villa
  std::array<RoadsideLine, 3> lines = {};

  // On the pavement or verge.
  double verge = 0.75;                                                    // beyond the kerb
  Range things = {6, 15};                                                 // from one to the next
  double boards = 0, posts = 0, lamps = 0.28, signs = 0.2, trees = 0.27;  // else street furniture
  Range parked = {0.2, 0.8};        // chance, by density, of a car in a lay-by
  std::array<double, 4> rows = {};  // of cars side by side, beyond the kerb; 0: none
  Range row_cars = {};              // chance, by density, of a car in such a row

  // Farther away.
  double wood_above = kNever;       // of another such field: close trees
  Range wood = {};                  // beyond the kerb
  Range far_houses = {0.25, 0.85};  // chance, by density
  Count far_floors = {1, 4}, far_plants = {2, 8};
  double far_trees = 0.6;  // share of the plants

  // Traffic.
  double oncoming_spacing = 90;    // 0: no car comes
  Range oncoming_speed = {6, 11};  // [m/s]
  double leader = 0.4;             // chance that a car drives ahead
  size_t trucks = 0;               // of the 12 models
};

const Scenery& scenery_of(Surroundings surroundings);

}  // namespace revisit::pipeline::simulation
