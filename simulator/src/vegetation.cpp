#include <algorithm>
#include <cmath>
#include <numbers>

#include "objects.h"

namespace revisit::simulation {
namespace {

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
