#pragma once

#include "mesh.h"
#include "random.h"

namespace revisit::pipeline::simulation {

// Objects of the town, each in a frame of its own: origin on the ground, z up [m].

/// A lorry centred on the origin, forward = x.
Mesh make_truck(Random& random);
/// A car centred on the origin, forward = x. `half` is filled with half its length and width.
Mesh make_car(Random& random, Eigen::Vector2d* half);

/// Walks along x.
Mesh make_person(Random& random);

/// Trunk at the origin, crown of the given radius.
Mesh make_tree(Random& random, double crown_radius);
Mesh make_bush(Random& random, double radius, double height);
/// From (0, 0) along x, half a thickness to each side of it.
Mesh make_hedge(Random& random, double length, double height, double thickness);

enum class FenceKind {
  kSlats,
  kBoards,
  kWall,
  kRailing,
  kHedge,  // is make_hedge()'s
  kPasture,
  kGuardRail,
  kConcrete,
  kScreen  // against noise
};
/// From (0, 0) along x.
Mesh make_fence(Random& random, FenceKind kind, double length, double height);

Mesh make_lamp(Random& random);
/// A knee-high post with a reflector.
Mesh make_post(Random& random);
/// A board of some metres on two legs that faces x.
Mesh make_board(Random& random);
Mesh make_sign(Random& random);
/// A bin, cabinet, bollard or bench within 0.7 m.
Mesh make_street_furniture(Random& random);

struct BuildingStyle {
  double width = 12, depth = 10;  // along x, along y [m]
  int floors = 2;
  double floor_height = 2.9;  // [m]
  bool detailed = true;       // with windows, doors, balconies: for houses seen from the road
  bool shop = false;          // large windows on the ground floor
};
/// A house whose front is the line y = 0 from x = 0 to `width`, and that fills y in [0, depth].
/// Up to kFacadeRelief stands out in front of it (y < 0): steps, balconies, bay windows, eaves.
Mesh make_building(Random& random, const BuildingStyle& style);
constexpr double kFacadeRelief = 1.1;  // [m]

}  // namespace revisit::pipeline::simulation
