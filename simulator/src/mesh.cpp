#include "mesh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace revisit::simulation {

Surface surface(Material material, double reflectance, Look look) {
  return {material, static_cast<uint8_t>(std::lround(std::clamp(reflectance, 0.0, 1.0) * 255)),
          look};
}

void Mesh::add(const std::array<uint32_t, 3>& corners, Surface s) {
  triangles.push_back(corners);
  surfaces.push_back(s);
  object_of.push_back(0);
}

void Mesh::triangle(const Vec& a, const Vec& b, const Vec& c, Surface s) {
  const auto first = static_cast<uint32_t>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c});
  add({first, first + 1, first + 2}, s);
}

void Mesh::quad(const Vec& a, const Vec& b, const Vec& c, const Vec& d, Surface s) {
  const auto first = static_cast<uint32_t>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c, d});
  add({first, first + 1, first + 2}, s);
  add({first, first + 2, first + 3}, s);
}

void Mesh::box(const Vec& low, const Vec& high, Surface s) {
  const auto corner = [&](int x, int y, int z) {
    return Vec(x ? high.x() : low.x(), y ? high.y() : low.y(), z ? high.z() : low.z());
  };
  quad(corner(0, 0, 0), corner(1, 0, 0), corner(1, 0, 1), corner(0, 0, 1), s);
  quad(corner(1, 0, 0), corner(1, 1, 0), corner(1, 1, 1), corner(1, 0, 1), s);
  quad(corner(1, 1, 0), corner(0, 1, 0), corner(0, 1, 1), corner(1, 1, 1), s);
  quad(corner(0, 1, 0), corner(0, 0, 0), corner(0, 0, 1), corner(0, 1, 1), s);
  quad(corner(0, 0, 1), corner(1, 0, 1), corner(1, 1, 1), corner(0, 1, 1), s);
}

void Mesh::cylinder(const Vec& foot, float radius, float top_radius, float height, int sides,
                    Surface s) {
  const auto rim = [&](int i, float r, float z) {
    const float angle =
        2 * std::numbers::pi_v<float> * static_cast<float>(i % sides) / static_cast<float>(sides);
    return Vec(foot + Vec(r * std::cos(angle), r * std::sin(angle), z));
  };
  const Vec top = foot + Vec(0, 0, height);
  for (int i = 0; i < sides; ++i) {
    quad(rim(i, radius, 0), rim(i + 1, radius, 0), rim(i + 1, top_radius, height),
         rim(i, top_radius, height), s);
    triangle(rim(i, top_radius, height), rim(i + 1, top_radius, height), top, s);
  }
}

void Mesh::append(const Mesh& object, const Placement& placement, std::optional<uint32_t> kind) {
  const auto first = static_cast<uint32_t>(vertices.size());
  const auto c = static_cast<float>(std::cos(placement.yaw));
  const auto s = static_cast<float>(std::sin(placement.yaw));
  for (const Vec& v : object.vertices)
    vertices.push_back(placement.origin + Vec(c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z()));
  for (const auto& t : object.triangles)
    triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  surfaces.insert(surfaces.end(), object.surfaces.begin(), object.surfaces.end());
  const auto number = static_cast<uint32_t>(objects.size());
  object_of.resize(triangles.size(), number);
  objects.push_back({placement.origin, {c, s}, kind.value_or(number)});
}

}  // namespace revisit::simulation
