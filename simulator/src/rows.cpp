#include "objects.h"
#include "random.h"
#include "site.h"

namespace revisit::simulation {
namespace {

/// Along equal lanes in turn, from the end at `a`.
Route along_lanes(int lanes, double a, double b, double first, double pitch) {
  Route route;
  for (int i = 0; i < lanes; ++i)
    for (const bool ahead : {i % 2 != 0, i % 2 == 0})
      route.emplace_back(ahead ? b : a, first + i * pitch, 0);
  return route;
}

// Garage: bays, aisle, bays; a column for three bays. EAR 05: bays of 2.5 x 5 m, aisles of 6 m.
constexpr int kModules = 4, kBays = 14;
constexpr double kBay = 2.6, kDeep = 5.25, kAisle = 6, kModule = 2 * kDeep + kAisle;  // [m]
constexpr double kGarage = kBays * kBay + 2 * kAisle, kClear = 2.5;                   // [m]
constexpr double kEmpty = 0.25, kOther = 0.3;  // chances; kOther: drawn again for the second round

void park(uint64_t seed, size_t round, Mesh* mesh) {
  for (int i = 0; i < 2 * kModules * kBays; ++i) {
    const uint64_t key = random_bits(seed, 0x626179, static_cast<uint64_t>(i));
    Random random(key, round > 0 && Random(key).chance(kOther) ? 2 : 1);
    if (random.chance(kEmpty)) continue;
    const int row = i / kBays, side = row % 2 ? 1 : -1;
    const double x = kAisle + (i % kBays + 0.5) * kBay + random.normal(0.1);
    const double y = (row / 2 + 0.5) * kModule + side * (kAisle + kDeep) / 2 + random.normal(0.15);
    Vec2 half;
    const Mesh car = make_car(random, &half);
    const double yaw = (random.chance(0.8) ? side : -side) * 90 * kDegree + random.normal(0.02);
    mesh->append(car, {vec({x, y}, 0), yaw});
  }
}

// Greenhouse: double rows of a high-wire crop, 3.2 m apart, pipe-rail paths between them (Venlo:
// spans of multiples of 3.2 m, gutters at 4 to 7 m).
constexpr int kBeds = 8;
constexpr double kPitch = 3.2, kBed = 24, kHeadland = 3, kPiece = 6, kGutter = 4.5;  // [m]

// Container yard: boxes of 40 and 20 feet (ISO 668), 0.4 m apart, up to 4 high; lanes of 6 m.
constexpr int kBlocks = 4, kStacks = 3, kRows = 4;
constexpr double kForty = 12.192, kTwenty = 6.058, kBox = 2.438, kTier = 2.591, kGap = 0.4;  // [m]
constexpr double kLane = 6, kBlock = kRows * (kBox + kGap) + kLane,
                 kYard = kStacks * (kForty + kGap);

void stack(Random& random, const Vec2& low, double length, Mesh* mesh) {
  for (int tiers = random.integer(0, 4), z = 0; z < tiers; ++z) {
    const Vec2 at = low + Vec2{random.normal(0.04), random.normal(0.04)};
    mesh->box(vec(at, z * kTier), vec(at + Vec2(length, kBox), (z + 1) * kTier), kMasonry);
  }
}

}  // namespace

Site make_garage(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  const Vec2 end(kGarage, kModules * kModule), half(0.25, 0.25);
  mesh->box(vec({0, 0}, 0), vec(end, kClear), kMasonry);
  decks({0, 0}, end, 0, kClear, mesh);
  for (int i = 0; i < 5 * (kModules + 1); ++i) {
    const Vec2 at(kAisle + i % 5 * 3 * kBay, i / 5 * kModule);
    mesh->box(vec(at - half, 0), vec(at + half, kClear), kMasonry);
  }
  for (const size_t round : {0, 1}) park(seed, round, &site.rounds.emplace_back());
  Route route = along_lanes(kModules, kAisle / 2, kGarage - kAisle / 2, kModule / 2, kModule);
  route.push_back(route.front());
  site.follow(route, 0.5, 0.3, seed, 2);
  return site;
}

Site make_greenhouse(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  Random random(seed, 0x63726f70);
  const Vec2 end(kBed + 2 * kHeadland, kBeds * kPitch);
  mesh->box(vec({0, 0}, 0), vec(end, kGutter), surface(Material::kGlass, 0.1));
  decks({0, 0}, end, 0, 0, mesh);
  for (int i = 0; i < kBeds * 4; ++i) {
    const Mesh::Vec at = vec({kHeadland + i % 4 * kPiece, (i / 4 + 0.5) * kPitch}, 0);
    const double height = random.uniform(1.8, 2.2), thickness = random.uniform(1.2, 1.6);
    mesh->append(make_hedge(random, kPiece, height, thickness), {at, 0});
    mesh->cylinder(at, 0.05f, 0.05f, f(kGutter), 6, kMasonry);
  }
  const Route route =
      along_lanes(kBeds - 1, kHeadland / 2, end.x() - kHeadland / 2, kPitch, kPitch);
  site.follow(there_and_back(route), 0.2, 0.8, seed);
  return site;
}

Site make_container_yard(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  Random random(seed, 0x79617264);
  decks({-60, -60}, {kYard + 60, kBlocks * kBlock + 60}, 0, 0, mesh);
  for (int i = 0; i < kBlocks * kRows * kStacks; ++i) {
    const int row = i / kStacks;
    const Vec2 low(i % kStacks * (kForty + kGap),
                   row / kRows * kBlock + row % kRows * (kBox + kGap));
    const bool twenty = random.chance(0.4);
    stack(random, low, twenty ? kTwenty : kForty, mesh);
    if (twenty) stack(random, low + Vec2(kForty - kTwenty, 0), kTwenty, mesh);
  }
  const double first = kBlock - kLane / 2;
  const Route route = along_lanes(kBlocks - 1, -kLane / 2, kYard + kLane / 2, first, kBlock);
  site.follow(there_and_back(route), 0.8, 0.5, seed);
  return site;
}

}  // namespace revisit::simulation
