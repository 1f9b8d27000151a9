#include <algorithm>

#include "objects.h"

namespace revisit::simulation {

Mesh make_fence(Random& random, FenceKind kind, double length, double height) {
  Mesh mesh;
  const float top = f(height), end = f(length);
  const Surface wood = surface(Material::kSolid, random.uniform(0.2, 0.5), Look::kWood);
  const Surface metal = surface(Material::kSolid, random.uniform(0.15, 0.4));
  const Surface stone = surface(Material::kSolid, random.uniform(0.25, 0.55), Look::kStone);
  switch (kind) {
    case FenceKind::kSlats: {
      const double pitch = random.uniform(0.14, 0.2), slat = pitch * random.uniform(0.5, 0.65);
      for (double x = 0; x + slat <= length; x += pitch)
        mesh.quad({f(x), 0, 0.05f}, {f(x + slat), 0, 0.05f}, {f(x + slat), 0, top}, {f(x), 0, top},
                  wood);
      for (const double z : {0.25, 0.8})
        mesh.quad({0, 0.02f, f(z * height)}, {end, 0.02f, f(z * height)},
                  {end, 0.02f, f(z * height) + 0.08f}, {0, 0.02f, f(z * height) + 0.08f}, wood);
      break;
    }
    case FenceKind::kBoards:
      mesh.box({0, -0.02f, 0.02f}, {end, 0.02f, top}, wood);
      for (double x = 0; x < length; x += 2)
        mesh.box({f(x), -0.06f, -0.2f}, {f(std::min(length, x + 0.1)), 0.06f, top + 0.08f}, wood);
      break;
    case FenceKind::kWall:
      mesh.box({0, -0.12f, -0.4f}, {end, 0.12f, top}, stone);
      for (double x = 0; x < length; x += 3.5)
        mesh.box({f(x), -0.2f, -0.4f}, {f(std::min(length, x + 0.4)), 0.2f, top + 0.15f}, stone);
      break;
    case FenceKind::kRailing:
      mesh.box({0, -0.1f, -0.4f}, {end, 0.1f, top * 0.4f}, stone);
      for (double x = 0.1; x + 0.03 <= length; x += 0.18)
        mesh.quad({f(x), 0, top * 0.4f}, {f(x) + 0.04f, 0, top * 0.4f}, {f(x) + 0.04f, 0, top},
                  {f(x), 0, top}, metal);
      break;
    case FenceKind::kHedge:
      break;
    case FenceKind::kPasture:
      mesh.cylinder({0.1f, 0, -0.3f}, 0.06f, 0.06f, top + 0.3f, 6, wood);
      for (const float z : {0.45f, 0.95f})
        mesh.quad({0, 0, z * top}, {end, 0, z * top}, {end, 0, z * top + 0.04f},
                  {0, 0, z * top + 0.04f}, wood);
      break;
    case FenceKind::kGuardRail:
      mesh.box({0, 0, -0.5f}, {0.1f, 0.12f, top - 0.05f}, metal);
      mesh.box({0, -0.06f, top - 0.32f}, {end, 0.06f, top}, metal);
      break;
    case FenceKind::kConcrete: {
      const auto side = [&](float y) {
        mesh.quad({0, y * 0.3f, -0.3f}, {end, y * 0.3f, -0.3f}, {end, y * 0.1f, top},
                  {0, y * 0.1f, top}, stone);
      };
      side(-1), side(1);
      mesh.quad({0, -0.1f, top}, {end, -0.1f, top}, {end, 0.1f, top}, {0, 0.1f, top}, stone);
      break;
    }
    case FenceKind::kScreen:
      mesh.box({0, -0.08f, -1}, {end, 0.08f, top}, wood);
      mesh.box({0, -0.14f, -1}, {0.2f, 0.14f, top + 0.1f}, metal);
      break;
  }
  return mesh;
}

Mesh make_lamp(Random& random) {
  Mesh mesh;
  const Surface metal = surface(Material::kSolid, random.uniform(0.3, 0.6));
  const double height = random.uniform(4.5, 8);
  mesh.cylinder({0, 0, -0.3f}, 0.1f, 0.06f, f(height + 0.3), 8, metal);
  mesh.cylinder({0, 0, -0.3f}, 0.14f, 0.14f, 1.2f, 8, metal);
  const float reach = f(random.uniform(0.3, 0.6));
  mesh.box({-0.1f, -0.04f, f(height)}, {reach, 0.04f, f(height) + 0.1f}, metal);
  return mesh;
}

Mesh make_post(Random& random) {
  Mesh mesh;
  const float top = f(random.uniform(0.9, 1.1));
  mesh.box({-0.06f, -0.06f, -0.2f}, {0.06f, 0.06f, top}, surface(Material::kSolid, 0.7));
  return mesh;
}

Mesh make_board(Random& random) {
  Mesh mesh;
  const float half = f(random.uniform(0.9, 1.8)), high = f(random.uniform(1.2, 2.6)),
              low = f(random.uniform(1.2, 2.2));
  const Surface metal = surface(Material::kSolid, 0.45);
  for (const float y : {-0.7f * half, 0.7f * half})
    mesh.cylinder({0, y, -0.5f}, 0.07f, 0.07f, low + high + 0.4f, 6, metal);
  mesh.box({0.08f, -half, low}, {0.12f, half, low + high}, surface(Material::kSolid, 0.9));
  return mesh;
}

Mesh make_sign(Random& random) {
  Mesh mesh;
  const float height = f(random.uniform(2.0, 2.7)), size = f(random.uniform(0.3, 0.42));
  mesh.cylinder({0, 0, -0.2f}, 0.035f, 0.035f, height + 0.2f, 6, surface(Material::kSolid, 0.45));
  // Retroreflective.
  const Surface sheet = surface(Material::kSolid, 1.0, Look::kTrafficSign);
  mesh.quad({0.04f, -size, height - 2 * size}, {0.04f, size, height - 2 * size},
            {0.04f, size, height}, {0.04f, -size, height}, sheet);
  return mesh;
}

Mesh make_street_furniture(Random& random) {
  Mesh mesh;
  const Surface plastic = surface(Material::kSolid, random.uniform(0.15, 0.6));
  switch (random.integer(0, 7) % 5) {  // columns are rarer
    case 0:                            // wheeled bins in a row
      for (int i = 0, n = random.integer(1, 2); i < n; ++i)
        mesh.box({-0.65f + 0.66f * f(i), -0.35f, 0}, {-0.05f + 0.66f * f(i), 0.35f, 1.1f}, plastic);
      break;
    case 1: {  // telephone or electricity cabinet
      const float wide = f(random.uniform(0.35, 0.65));
      mesh.box({-wide, -0.18f, 0}, {wide, 0.18f, f(random.uniform(0.9, 1.5))}, plastic);
      break;
    }
    case 2:  // bollards
      for (const float x : {-0.6f, 0.f, 0.6f})
        mesh.cylinder({x, 0, -0.1f}, 0.06f, 0.06f, f(random.uniform(0.9, 1.1)), 6, plastic);
      break;
    case 3:  // bench
      mesh.box({-0.68f, -0.2f, 0.4f}, {0.68f, 0.2f, 0.46f}, plastic);
      mesh.box({-0.68f, 0.18f, 0.46f}, {0.68f, 0.22f, 0.85f}, plastic);
      for (const float x : {-0.6f, 0.5f})
        mesh.box({x, -0.18f, 0}, {x + 0.1f, 0.18f, 0.4f}, plastic);
      break;
    default:  // advertising column
      mesh.cylinder({0, 0, -0.1f}, 0.6f, 0.6f, f(random.uniform(2.4, 3.0)), 14,
                    {plastic.material, plastic.reflectance, Look::kPosters});
  }
  return mesh;
}

}  // namespace revisit::simulation
