#include "objects.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

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

using Vec = Mesh::Vec;

Vec random_direction(Random& random) {
  const double z = random.uniform(-1, 1), a = random.uniform(0, 2 * std::numbers::pi);
  const double r = std::sqrt(1 - z * z);
  return Eigen::Vector3d(r * std::cos(a), r * std::sin(a), z).cast<float>();
}

Surface leaves(Random& random) {
  return surface(Material::kLeaves, random.uniform(0.25, 0.5), Look::kLeaves);
}

void tuft(Random& random, const Vec& center, double size, Surface s, Mesh* mesh) {
  const Vec a = random_direction(random), b = a.unitOrthogonal(), c = a.cross(b);
  const auto r = static_cast<float>(size * random.uniform(0.5, 0.8));
  mesh->triangle(center + r * b, center + r * (-0.5f * b + 0.87f * c),
                 center + r * (-0.5f * b - 0.87f * c), s);
}

void foliage(Random& random, const Vec& center, const Vec& radii, int count, double size,
             Mesh* mesh) {
  const Surface s = leaves(random);
  for (int i = 0; i < count; ++i) {
    const auto depth = static_cast<float>(std::cbrt(random.uniform(0.25, 1.0)));
    tuft(random, center + depth * random_direction(random).cwiseProduct(radii), size, s, mesh);
  }
}

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

Mesh make_person(Random& random) {
  Mesh mesh;
  const double height = random.uniform(1.55, 1.9), hip = 0.5 * height, shoulder = 0.82 * height;
  const Surface trousers = surface(Material::kSolid, random.uniform(0.1, 0.5));
  const Surface jacket = surface(Material::kSolid, random.uniform(0.1, 0.7));
  const Surface skin = surface(Material::kSolid, 0.5);
  const double stride = random.uniform(0.05, 0.3);
  for (const double side : {-1.0, 1.0}) {
    // A leg has two pieces: the foot is ahead or behind by the stride, the knee by half of it.
    for (const auto& [share, low, high] : {std::array{1.0, 0.0, 0.5}, std::array{0.4, 0.5, 1.0}})
      mesh.cylinder({f(side * share * stride), f(0.1 * side), f(low * hip)}, 0.07f, 0.09f,
                    f((high - low) * hip), 6, trousers);
    mesh.cylinder({f(-0.5 * side * stride), f(0.26 * side), f(0.48 * height)}, 0.05f, 0.06f,
                  f(shoulder - 0.48 * height), 6, jacket);
  }
  mesh.cylinder({0, 0, f(hip)}, 0.16f, 0.21f, f(shoulder - hip), 10, jacket);
  mesh.cylinder({0, 0, f(shoulder)}, 0.06f, 0.06f, f(0.05 * height), 6, skin);
  mesh.cylinder({0, 0, f(0.87 * height)}, 0.09f, 0.08f, f(0.13 * height), 8, skin);
  return mesh;
}

Mesh make_tree(Random& random, double crown_radius) {
  Mesh mesh;
  const bool conifer = random.chance(0.2);
  const double trunk = conifer ? random.uniform(0.3, 1.2) : random.uniform(1.8, 3.2);
  const double height =
      crown_radius * (conifer ? random.uniform(3, 4.5) : random.uniform(1.7, 2.6));
  const double radius = 0.06 * crown_radius + random.uniform(0.04, 0.12);
  const Surface bark = surface(Material::kSolid, random.uniform(0.15, 0.35), Look::kBark);
  mesh.cylinder({0, 0, -0.3f}, f(radius), f(radius * 0.6), f(0.3 + trunk + height * 0.6), 7, bark);
  const int tufts = static_cast<int>(90 * crown_radius * crown_radius * std::sqrt(height / 4)) + 60;
  if (conifer) {
    const Surface s = leaves(random);
    for (int i = 0; i < tufts; ++i) {
      const double up = 1 - std::sqrt(random.uniform()), r = crown_radius * (1 - up);
      const double angle = random.uniform(0, 2 * std::numbers::pi), in = random.uniform(0.6, 1.0);
      tuft(random,
           {f(r * in * std::cos(angle)), f(r * in * std::sin(angle)), f(trunk + up * height)}, 0.5,
           s, &mesh);
    }
    return mesh;
  }
  // A crown is a few overlapping balls, so that every tree has its own outline.
  const int balls = random.integer(3, 5);
  for (int i = 0; i < balls; ++i) {
    const double r = crown_radius * random.uniform(0.5, 0.75), out = crown_radius - r;
    const double angle = random.uniform(0, 2 * std::numbers::pi);
    const double z = trunk + height * random.uniform(0.25, 0.8);
    foliage(random, {f(out * std::cos(angle)), f(out * std::sin(angle)), f(z)},
            {f(r), f(r), f(std::min(height * 0.4, r * 1.2))}, tufts / balls, 0.5, &mesh);
  }
  return mesh;
}

Mesh make_bush(Random& random, double radius, double height) {
  Mesh mesh;
  const int tufts = static_cast<int>(110 * radius * height) + 30;
  foliage(random, {0, 0, f(height * 0.45)}, {f(radius), f(radius), f(height * 0.55)}, tufts, 0.35,
          &mesh);
  return mesh;
}

Mesh make_hedge(Random& random, double length, double height, double thickness) {
  Mesh mesh;
  const Surface s = leaves(random);
  const float inner = f(thickness / 2 - 0.1);
  const double step = 0.5;
  for (double x = 0; x < length; x += step) {
    const double top = height * random.uniform(0.88, 1.0);
    const float left = inner * f(random.uniform(0.75, 1.0)),
                right = inner * f(random.uniform(0.75, 1.0));
    mesh.box({f(x), -right, -0.3f}, {f(std::min(length, x + step)), left, f(top)}, s);
  }
  const int tufts = static_cast<int>(length * (2 * height + thickness) * 10);
  for (int i = 0; i < tufts; ++i) {
    const double place = random.uniform(0, 2 * height + thickness);
    const float x = f(random.uniform(0.1, std::max(0.2, length - 0.1)));
    const Vec p = place < height       ? Vec(x, -inner, f(place))
                  : place < 2 * height ? Vec(x, inner, f(place - height))
                                       : Vec(x, f(place - 2 * height - thickness / 2), f(height));
    tuft(random, p, 0.3, s, &mesh);
  }
  return mesh;
}

}  // namespace revisit::simulation
