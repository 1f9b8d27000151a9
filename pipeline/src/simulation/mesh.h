#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace revisit::pipeline::simulation {

/// How a surface answers the laser, beyond its reflectance.
enum class Material : uint8_t {
  kSolid,
  kRoad,
  kLawn,    // blades of grass: rough by centimetres
  kLeaves,  // rough by centimetres
  kGlass,   // mostly no return
  kPaint    // glossy: no return at grazing incidence
};

struct Surface {
  Material material = Material::kSolid;
  uint8_t reflectance = 0;  // of 255, at normal incidence
};

/// Surface of the given reflectance in [0, 1].
Surface surface(Material material, double reflectance);

/// Where an object stands: its origin, and the direction its x axis points to [rad].
struct Placement {
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();  // [m]
  double yaw = 0;
};

/// Triangles, each with a surface. Faces are seen from both sides. Units: metres.
class Mesh {
 public:
  using Vec = Eigen::Vector3f;

  std::vector<Vec> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<Surface> surfaces;  // [triangle]

  void triangle(const Vec& a, const Vec& b, const Vec& c, Surface s);
  /// Corners in order around the face.
  void quad(const Vec& a, const Vec& b, const Vec& c, const Vec& d, Surface s);
  /// Axis-aligned box without its underside.
  void box(const Vec& low, const Vec& high, Surface s);
  /// Upright tapered cylinder of `sides` faces, closed on top.
  void cylinder(const Vec& foot, float radius, float top_radius, float height, int sides,
                Surface s);
  void append(const Mesh& object, const Placement& placement);
};

}  // namespace revisit::pipeline::simulation
