#include <algorithm>
#include <array>
#include <cmath>

#include "objects.h"
#include "random.h"
#include "site.h"

namespace revisit::simulation {
namespace {

// Stairwell with half landings: steps of 17.5 x 28 cm, flights of 1.2 m (DIN 18065).
constexpr int kStoreys = 5, kSteps = 10;  // steps of a flight
constexpr double kRise = 0.175, kGoing = 0.28, kFlight = 1.2, kLanding = 1.4, kHall = 2.7;  // [m]
constexpr double kShaft = 2 * kFlight + 0.2, kBack = kLanding + kSteps * kGoing;
constexpr double kEnd = kBack + kLanding,
                 kHalf = kSteps * kRise;  // kHalf: height of a half landing

void flight(const Vec2& foot, double forward, double z, Mesh* mesh) {
  const Vec2 across(kFlight, 0), going(0, forward * kGoing);
  for (int i = 0; i < kSteps; ++i) {
    const Vec2 edge = foot + i * going;
    walls({edge, edge + across}, z + i * kRise, z + (i + 1) * kRise, mesh);
    decks(edge, edge + across + going, z + (i + 1) * kRise, z + (i + 1) * kRise, mesh);
  }
}

/// A wall with a door; behind an open one is a hall of random size.
void door_wall(Random& random, double z, double top, Mesh* mesh) {
  const Vec2 zero(0, 0), a(0.3, 0), b(1.3, 0), end(kShaft, 0);
  walls({zero, a}, z, top, mesh), walls({b, end}, z, top, mesh);
  walls({a, b}, z + 2.1, top, mesh);
  const Vec2 low{-random.uniform(0, 4), -random.uniform(1.5, 8)};
  const Vec2 high(kShaft + random.uniform(0, 3), 0);
  if (random.chance(0.3)) return walls({a, b}, z, z + 2.1, mesh);
  walls({zero, {low.x(), 0}, low, {high.x(), low.y()}, high, end}, z, z + kHall, mesh);
  decks(low, high, z, z + kHall, mesh);
}

// Haulage drift for loaders, drilled and blasted: 4.6 x 4.1 m, overbreak of decimeters (SME Mining
// Engineering Handbook).
constexpr double kDrift = 160, kStep = 0.5, kBore = 2.3, kAxis = 1.8;  // kAxis: height [m]
constexpr double kRough = 0.5, kRoughLength = 1.8;                     // height, wavelength [m]
constexpr size_t kCorners = 14;                                        // of a profile

// Path in a high forest: 400 to 800 trees per hectare.
constexpr double kPath = 160, kAside = 26, kSpacing = 4;  // length, width of the wood [m]

/// `aside`: to the left of the path [m].
Eigen::Vector3d on_soil(uint64_t seed, double x, double aside) {
  const double y = 30 * value_noise(seed ^ 1, x, 0, 80) + aside;
  return {x, y, 5 * value_noise(seed ^ 3, x, y, 60) + 0.3 * value_noise(seed ^ 4, x, y, 5)};
}

}  // namespace

Site make_stairwell(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  Random random(seed, 0x737461697273);
  const double top = 2 * kHalf * kStoreys + kHall, left = kFlight / 2, right = kShaft - left;
  const double front = kLanding / 2, back = kBack + front;
  Route route;
  for (int storey = 0; storey <= kStoreys; ++storey) {
    const double z = 2 * kHalf * storey, half = z + kHalf, next = half + kHalf;
    decks({0, 0}, {kShaft, kLanding}, z, z, mesh);
    door_wall(random, z, std::min(top, next), mesh);
    if (storey == kStoreys) break;
    flight({0, kLanding}, 1, z, mesh);
    decks({0, kBack}, {kShaft, kEnd}, half, half, mesh);
    flight({kShaft - kFlight, kBack}, -1, half, mesh);
    const Route up = {{left, front, z},        {left, kLanding, z}, {left, kBack, half},
                      {left, back, half},      {right, back, half}, {right, kBack, half},
                      {right, kLanding, next}, {right, front, next}};
    route.insert(route.end(), up.begin(), up.end());
  }
  walls({{0, 0}, {0, kEnd}, {kShaft, kEnd}, {kShaft, 0}}, 0, top, mesh);
  decks({0, 0}, {kShaft, kEnd}, 0, top, mesh);
  site.follow(there_and_back(route), 0.1, 3, seed, 2);
  return site;
}

Site make_mine(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  Random random(seed, 0x6d696e65);
  Route route;
  std::array<Mesh::Vec, kCorners> ring, last;
  Vec2 middle(0, 0);
  double heading = 0, turn = 0;  // turn: [rad per step]
  for (double s = 0; s <= kDrift; s += kStep) {
    for (size_t k = 0; k < kCorners; ++k) {
      const double angle = 360 * kDegree * static_cast<double>(k) / kCorners;
      const double noise = 2 * value_noise(random_bits(seed, k), s, 0, kRoughLength) - 1;
      const double radius = kBore + kRough * noise, left = radius * std::cos(angle);
      ring[k] = vec(middle + left * Vec2(-std::sin(heading), std::cos(heading)),
                    std::max(0.0, kAxis + radius * std::sin(angle)));
    }
    for (size_t k = 0; k < kCorners; ++k) {
      const size_t next = (k + 1) % kCorners;
      if (s > 0) mesh->quad(last[k], last[next], ring[next], ring[k], kMasonry);
      if (s == 0 || s + kStep > kDrift)
        mesh->triangle(ring[k], ring[next], vec(middle, 1), kMasonry);
    }
    if (s >= 3 && s + 3 <= kDrift) route.emplace_back(middle.x(), middle.y(), 0);
    last = ring;
    middle += kStep * Vec2(std::cos(heading), std::sin(heading));
    heading += turn = 0.9 * turn + random.normal(0.012);
  }
  site.follow(there_and_back(route), 0.4, 1.5, seed);
  return site;
}

Site make_forest(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  Random random(seed, 0x7472656573);
  Route route;
  for (double x = -kAside; x < kPath + kAside; ++x) {
    if (x >= 0 && x <= kPath) route.push_back(on_soil(seed, x, 0));
    const auto at = [&](double i, double y) -> Mesh::Vec {
      return on_soil(seed, x + i, y).cast<float>();
    };
    for (double y = -kAside; y < kAside; ++y)
      mesh->quad(at(0, y), at(1, y), at(1, y + 1), at(0, y + 1), surface(Material::kLawn, 0.35));
  }
  for (double x = -kAside; x < kPath + kAside; x += kSpacing)
    for (double y = -kAside; y < kAside; y += kSpacing) {
      const double along = x + random.uniform(0, kSpacing);
      const double aside = y + random.uniform(0, kSpacing);
      const bool bush = random.chance(0.12);
      const double reach = bush ? 0.8 : random.uniform(1.4, 2.6);
      const Mesh plant =
          bush ? make_bush(random, reach, random.uniform(0.5, 1.6)) : make_tree(random, reach);
      if (std::abs(aside) > reach + 1)
        mesh->append(plant, {on_soil(seed, along, aside).cast<float>(), 0});
    }
  site.follow(there_and_back(route), 0.4, 3, seed);
  return site;
}

}  // namespace revisit::simulation
