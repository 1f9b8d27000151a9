#include <algorithm>
#include <array>

#include "objects.h"

namespace revisit::simulation {
namespace {

/// Side view, in fractions of length and height, from the rear over the roof to the front bumper.
struct Body {
  double length, width, height;  // [m]
  double belt;                   // height of the lower edge of the windows, fraction
  std::array<double, 4> top;  // x fractions: rear window foot, roof rear, roof front, screen foot
  double bonnet;              // height of the front edge, fraction
};

constexpr std::array<Body, 5> kBodies = {{
    {4.1, 1.74, 1.46, 0.62, {0.03, 0.14, 0.58, 0.78}, 0.50},  // hatchback
    {4.6, 1.78, 1.44, 0.63, {0.12, 0.27, 0.58, 0.75}, 0.50},  // saloon
    {4.7, 1.80, 1.50, 0.62, {0.02, 0.10, 0.58, 0.75}, 0.50},  // estate
    {4.5, 1.85, 1.72, 0.60, {0.03, 0.10, 0.62, 0.78}, 0.56},  // off-roader
    {5.1, 1.95, 2.05, 0.55, {0.01, 0.03, 0.72, 0.86}, 0.50},  // van
}};

}  // namespace

Mesh make_car(Random& random, Eigen::Vector2d* half) {
  const Body& body = kBodies[static_cast<size_t>(random.integer(0, 4))];
  const double scale = random.uniform(0.95, 1.05);
  const double l = body.length * scale, w = body.width * scale, h = body.height * scale;
  *half = {l / 2, w / 2};
  const Surface paint = surface(Material::kPaint, random.uniform(0.06, 0.7), Look::kCarBody);
  const Surface end{paint.material, paint.reflectance, Look::kCarEnd};
  const Surface glass = surface(Material::kGlass, 0.08, Look::kCarGlass);
  const Surface tyre = surface(Material::kSolid, 0.05);

  Mesh mesh;
  const float y = static_cast<float>(w / 2), roof_y = y * 0.78f;
  const auto at = [&](double x, double z, float side) {
    return Mesh::Vec(static_cast<float>((x - 0.5) * l), side, static_cast<float>(z * h));
  };
  const double sill = 0.15, belt = body.belt, roof = 1.0;
  const auto& t = body.top;
  const auto across = [&](double x0, double z0, float y0, double x1, double z1, float y1,
                          Surface s) {
    mesh.quad(at(x0, z0, -y0), at(x0, z0, y0), at(x1, z1, y1), at(x1, z1, -y1), s);
  };
  across(0, sill, y, 0, belt, y, end);
  across(0, belt, y, t[0], belt, y, paint);
  across(t[3], belt, y, 1 - 0.02, body.bonnet, y, paint);
  across(1 - 0.02, body.bonnet, y, 1, sill, y, end);
  // Greenhouse: rear window, roof, windscreen.
  across(t[0], belt, y, t[1], roof, roof_y, glass);
  across(t[1], roof, roof_y, t[2], roof, roof_y, paint);
  across(t[2], roof, roof_y, t[3], belt, y, glass);
  for (const float side : {-1.f, 1.f}) {
    mesh.quad(at(0, sill, side * y), at(1, sill, side * y), at(0.98, body.bonnet, side * y),
              at(t[3], belt, side * y), paint);
    mesh.quad(at(0, sill, side * y), at(t[3], belt, side * y), at(t[0], belt, side * y),
              at(0, belt, side * y), paint);
    const double mid_roof = (t[1] + t[2]) / 2, mid_belt = (t[0] + t[3]) / 2, pillar = 0.015;
    mesh.quad(at(t[0], belt, side * y), at(mid_belt - pillar, belt, side * y),
              at(mid_roof - pillar, roof, side * roof_y), at(t[1], roof, side * roof_y), glass);
    mesh.quad(at(mid_belt + pillar, belt, side * y), at(t[3], belt, side * y),
              at(t[2], roof, side * roof_y), at(mid_roof + pillar, roof, side * roof_y), glass);
    mesh.quad(at(mid_belt - pillar, belt, side * y), at(mid_belt + pillar, belt, side * y),
              at(mid_roof + pillar, roof, side * roof_y),
              at(mid_roof - pillar, roof, side * roof_y), paint);
    for (const double x : {0.19, 0.81}) {
      const auto cx = static_cast<float>((x - 0.5) * l);
      const float r = 0.32f, inner = side * (y - 0.2f), outer = side * (y - 0.01f);
      mesh.box({cx - r, std::min(inner, outer), 0}, {cx + r, std::max(inner, outer), 2 * r}, tyre);
    }
  }
  return mesh;
}

Mesh make_truck(Random& random) {
  const float half = static_cast<float>(random.uniform(4, 7)), y = 1.25f;
  const float top = static_cast<float>(random.uniform(3, 4));
  const Surface cover = surface(Material::kSolid, random.uniform(0.2, 0.7));
  const Surface paint = surface(Material::kPaint, random.uniform(0.1, 0.7));
  const Surface glass = surface(Material::kGlass, 0.08, Look::kCarGlass);
  const Surface tyre = surface(Material::kSolid, 0.05);
  Mesh mesh;
  const float cab = half - 2.2f;
  mesh.box({-half, -y, 1.1f}, {cab - 0.4f, y, top}, cover);
  mesh.quad({-half, -y, 1.1f}, {cab, -y, 1.1f}, {cab, y, 1.1f}, {-half, y, 1.1f}, tyre);
  mesh.box({cab, -y, 0.4f}, {half, y, 1.8f}, paint);
  mesh.box({cab, -y, 1.8f}, {half - 0.1f, y, 2.7f}, glass);
  mesh.box({cab, -y, 2.7f}, {half - 0.2f, y, top - 0.2f}, paint);
  for (const float x : {-half + 1, -half + 2.3f, cab + 0.9f})
    for (const float side : {-y, y - 0.35f})
      mesh.box({x - 0.5f, side, 0}, {x + 0.5f, side + 0.35f, 1}, tyre);
  return mesh;
}

}  // namespace revisit::simulation
