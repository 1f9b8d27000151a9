#pragma once

#include "mesh.h"
#include "random.h"

namespace revisit::simulation {

// Objects of the town, each in its own frame: origin on the ground, z up [m].

/// Centered on the origin, forward = x.
Mesh make_truck(Random& random);
/// Centered on the origin, forward = x. Writes half its length and width to `half`.
Mesh make_car(Random& random, Eigen::Vector2d* half);

/// Walks along x.
Mesh make_person(Random& random);

/// The trunk is at the origin.
Mesh make_tree(Random& random, double crown_radius);
Mesh make_bush(Random& random, double radius, double height);
/// From (0, 0) along x, centered on y = 0.
Mesh make_hedge(Random& random, double length, double height, double thickness);

enum class FenceKind {
  kSlats,
  kBoards,
  kWall,
  kRailing,
  kHedge,  // made by make_hedge()
  kPasture,
  kGuardRail,
  kConcrete,
  kScreen  // noise barrier
};
/// From (0, 0) along x.
Mesh make_fence(Random& random, FenceKind kind, double length, double height);

Mesh make_lamp(Random& random);
Mesh make_post(Random& random);
/// Faces x.
Mesh make_board(Random& random);
Mesh make_sign(Random& random);
/// Bin, cabinet, bollard, bench or advertising column, within 0.7 m.
Mesh make_street_furniture(Random& random);

struct BuildingStyle {
  double width = 12, depth = 10;  // [m], along x, along y
  int floors = 2;
  double floor_height = 2.9;  // [m]
  bool detailed = true;       // with windows, doors and balconies, for houses near the road
  bool shop = false;          // large windows on the ground floor
};
/// Front on y = 0 from x = 0 to `width`, filling y in [0, depth]. Steps, balconies, bay windows and
/// eaves protrude by up to kFacadeRelief (y < 0).
Mesh make_building(Random& random, const BuildingStyle& style);
constexpr double kFacadeRelief = 1.1;  // [m]

}  // namespace revisit::simulation
