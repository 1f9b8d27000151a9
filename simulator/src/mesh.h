#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace revisit::simulation {

inline float f(double value) {
  return static_cast<float>(value);
}

/// Response of a surface to the laser, besides its reflectance.
enum class Material : uint8_t {
  kSolid,
  kRoad,
  kLawn,    // grass: roughness of centimeters
  kLeaves,  // roughness of centimeters
  kGlass,   // mostly no return
  kPaint    // glossy: no return at grazing incidence
};

/// Appearance of a surface for cameras only.
enum class Look : uint8_t {
  kPlain,
  kGround,  // asphalt, kerb, slabs or lawn, by distance from the kerb
  kWall,    // plaster, brick, stone or boards, chosen per house
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
  uint8_t reflectance = 0;  // fraction of 255, at normal incidence
  Look look = Look::kPlain;
};

/// `reflectance` is in [0, 1].
Surface surface(Material material, double reflectance, Look look = Look::kPlain);

struct Placement {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  // [m]
  double yaw = 0;                                    // direction of the x axis [rad]
};

/// Objects of one `kind` look alike.
struct Object {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();   // [m]
  Eigen::Vector2f x_axis = Eigen::Vector2f::UnitX();  // unit
  uint32_t kind = 0;
};

/// Triangles are visible from both sides. Units: meters.
class Mesh {
 public:
  using Vec = Eigen::Vector3f;

  std::vector<Vec> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<Surface> surfaces;       // [triangle]
  std::vector<uint32_t> object_of;     // [triangle], index of its object
  std::vector<Object> objects = {{}};  // the first holds all triangles that were not appended
  std::vector<float> from_kerb;        // [vertex] of the ground, which comes first: outwards [m]

  void add(const std::array<uint32_t, 3>& corners, Surface s);
  void triangle(const Vec& a, const Vec& b, const Vec& c, Surface s);
  /// Corners are in order around the face.
  void quad(const Vec& a, const Vec& b, const Vec& c, const Vec& d, Surface s);
  /// Axis-aligned, without its underside.
  void box(const Vec& low, const Vec& high, Surface s);
  /// Upright and tapered, with `sides` faces, closed on top.
  void cylinder(const Vec& foot, float radius, float top_radius, float height, int sides,
                Surface s);
  /// Kind of the object is `kind`, or else its index here.
  void append(const Mesh& object, const Placement& placement, std::optional<uint32_t> kind = {});
};

}  // namespace revisit::simulation
