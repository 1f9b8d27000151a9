#pragma once

#include <array>

#include "objects.h"
#include "revisit/simulation/simulation.h"

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
  double kinds_an_owner = 0;
  Fences kinds = {};
  Range height;            // [m]
  bool left_only = false;  // between two carriageways
  bool joined = true;      // without gaps on the outside of a bend, and once for all passes
};

/// What surroundings are made of. Lengths are in metres, shares and chances in [0, 1]. "By density"
/// is a chance where a smooth random field is 0 and where it is 1.
struct Scenery {
  const char* name;
  bool equal;  // lots and things along the road are alike, built of the same random numbers

  // The road.
  double oncoming;             // the lane of oncoming cars, to the left of the driven path
  Range kerb;                  // from the lane's centre: without a lay-by, with one
  double kerb_height, paving;  // paving: width of the pavement
  bool asphalt;                // all the ground is
  double bank_height;          // of dams and cuttings, at most
  Range bank;                  // beyond the kerb: its foot, its top
  Range side_streets;          // between streets that nobody drives; 0: there are none
  Range side_street_width;

  // Lots beside the road.
  double front;                                 // beyond the kerb
  double open_below, green_below, urban_above;  // density: no lot, garden, house in a row
  double smallest_width, smallest_depth;        // of a lot with a house
  Range urban_width, green_width, villa_width, urban_depth, other_depth;
  double gapless;  // chance that a house in a row touches the next one
  Count urban_floors, villa_floors;
  double recessed, shops;  // chances, of houses in a row
  Range setback, beside;   // of villas: from the front, free width
  Fences fences;           // the tall ones
  double tall_fences;      // chance
  std::array<RoadsideLine, 3> lines;

  // On the pavement or verge.
  double verge;                               // beyond the kerb
  Range things;                               // from one to the next
  double boards, posts, lamps, signs, trees;  // shares; the rest is street furniture
  Range parked;                               // chance, by density, of a car in a lay-by
  std::array<double, 4> rows;                 // of cars side by side, beyond the kerb; 0: none
  Range row_cars;                             // chance, by density, of a car in such a row

  // Farther away.
  double wood_above;  // of another such field: close trees
  Range wood;         // beyond the kerb
  Range far_houses;   // chance, by density
  Count far_floors, far_plants;
  double far_trees;  // share of the plants

  // Traffic.
  double oncoming_spacing;  // 0: no car comes
  Range oncoming_speed;     // [m/s]
  double leader;            // chance that a car drives ahead
  size_t trucks;            // of the 12 models
};

const Scenery& scenery_of(Surroundings surroundings);

}  // namespace revisit::pipeline::simulation
