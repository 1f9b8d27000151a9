#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "mesh.h"
#include "revisit/datasets/dataset.h"

namespace revisit::simulation {

using Vec2 = Eigen::Vector2d;
using Route = std::vector<Eigen::Vector3d>;  // corners, on the floor [m]

/// Surroundings off the street with the drive of a robot, 1 m/s and ten poses per second.
struct Site {
  Mesh mesh;                       // what stays; z up [m]
  std::vector<Mesh> rounds;        // [round], what differs between rounds, if anything
  std::vector<Pose> T_site_floor;  // [frame], below the sensor, x forward; tilted as the robot is
  std::vector<size_t> round_of;    // [frame]

  Mesh differing(size_t frame) const { return rounds.empty() ? Mesh{} : rounds[round_of[frame]]; }
  /// Appends drives, up to `wander` [m] to either side of the route, with roll and pitch of
  /// standard deviation `sway` [deg]. The robot turns on the spot. It tilts on ramps, not on
  /// stairs.
  void follow(const Route& route, double wander, double sway, uint64_t seed, size_t count = 1);
};
Route there_and_back(Route route);

Mesh::Vec vec(const Vec2& point, double z);
const Surface kMasonry = surface(Material::kSolid, 0.5);  // plaster, concrete
/// Upright rectangles above a line.
void walls(const std::vector<Vec2>& line, double low, double high, Mesh* mesh);
/// Floor and ceiling between two corners.
void decks(const Vec2& a, const Vec2& b, double low, double high, Mesh* mesh);

/// `irregular`: rooms differ in width, depth and position of the door. `changed`: chance that a
/// door or a piece of furniture differs in the second round. `sway`: of the carrier [deg].
Site make_office(uint64_t seed, bool irregular, double changed, double sway);
Site make_floors(uint64_t seed);
Site make_stairwell(uint64_t seed);
Site make_mine(uint64_t seed);
Site make_forest(uint64_t seed);
Site make_garage(uint64_t seed);
Site make_greenhouse(uint64_t seed);
Site make_container_yard(uint64_t seed);

}  // namespace revisit::simulation
