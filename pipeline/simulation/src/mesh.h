#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace revisit::pipeline::simulation {

inline float f(double value) {
  return static_cast<float>(value);
}

/// How a surface answers the laser, beyond its reflectance.
enum class Material : uint8_t {
  kSolid,
  kRoad,
  kLawn,    // blades of grass: rough by centimetres
  kLeaves,  // rough by centimetres
  kGlass,   // mostly no return
  kPaint    // glossy: no return at grazing incidence
};

/// What a camera sees on a surface. The laser does not know it.
enum class Look : uint8_t {
  kPlain,
  kGround,  // asphalt, kerb, slabs and lawn, by the distance from the kerb
  kWall,    // plaster, brick, stone or boards, by the house
  kRoof,
  kWindow,
  kDoor,
  kGarageDoor,
  kShutter,
  kStone,
  kWood,
  kBark,
  kLeaves,
  kTrafficSign,
  kPosters,
  kCarBody,
  kCarEnd,  // front or rear: lamps and a number plate
  kCarGlass
};

struct Surface {
  Material material = Material::kSolid;
  uint8_t reflectance = 0;  // of 255, at normal incidence
  Look look = Look::kPlain;
};

/// `reflectance` is in [0, 1].
Surface surface(Material material, double reflectance, Look look = Look::kPlain);

/// Where an object stands: its origin, and the direction its x axis points to [rad].
struct Placement {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  // [m]
  double yaw = 0;
};

/// No two objects of one `kind` look alike.
struct Object {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();   // [m]
  Eigen::Vector2f x_axis = Eigen::Vector2f::UnitX();  // unit
  uint32_t kind = 0;
};

/// Triangles, each with a surface. Faces are seen from both sides. Units: metres.
class Mesh {
 public:
  using Vec = Eigen::Vector3f;

  std::vector<Vec> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<Surface> surfaces;       // [triangle]
  std::vector<uint32_t> object_of;     // [triangle], index of its object
  std::vector<Object> objects = {{}};  // the first is all that was made here, not appended
  std::vector<float> from_kerb;        // [vertex] of the ground, which is made first: outwards [m]

  void add(const std::array<uint32_t, 3>& corners, Surface s);
  void triangle(const Vec& a, const Vec& b, const Vec& c, Surface s);
  /// Corners in order around the face.
  void quad(const Vec& a, const Vec& b, const Vec& c, const Vec& d, Surface s);
  /// Axis-aligned box without its underside.
  void box(const Vec& low, const Vec& high, Surface s);
  /// Upright tapered cylinder of `sides` faces, closed on top.
  void cylinder(const Vec& foot, float radius, float top_radius, float height, int sides,
                Surface s);
  /// The object becomes one object of this mesh. Its kind is `kind`, or else its number here.
  void append(const Mesh& object, const Placement& placement, std::optional<uint32_t> kind = {});
};

}  // namespace revisit::pipeline::simulation
