#include "objects.h"

namespace revisit::simulation {

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

}  // namespace revisit::simulation
