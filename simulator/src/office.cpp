#include <algorithm>
#include <array>

#include "random.h"
#include "site.h"

namespace revisit::simulation {
namespace {

// Cell offices on both sides of a ring corridor. Usual: corridors of 1.5 to 2.4 m (ASR A1.8), doors
// of 1.01 x 2.13 m (DIN 18101), offices three axes of 1.35 m wide and 5 m deep.
constexpr double kLong = 44, kBroad = 30, kCorridor = 2, kCeiling = 2.8, kStorey = 3.5;  // [m]
constexpr double kDoor = 1, kDoorTop = 2.1, kRoom = 4, kDeepest = 7, kMoved = 0.6;       // [m]
constexpr double kClosed = 0.45;                                                         // chance

struct Storey {
  uint64_t seed = 0, furniture_seed = 0;
  bool irregular = false;
  double changed = 0, floor = 0,
         way_out = -1;  // way_out: x where the first wall is open, if not below 0 [m]
  Random rooms{seed, 0x726f6f6d}, furniture{furniture_seed, 0x6465736b}, changes{seed, 0x63};

  void build(Mesh* mesh) {
    constexpr double c = kCorridor, w = kLong, d = kBroad, x = w - c, y = d - c, m = kDeepest;
    // Outer, then inner walls. Rooms at the ends of the core's short sides would meet others.
    rooms_left_of({x, 0}, {c, 0}, 0, mesh), rooms_left_of({0, 0}, {0, d}, 0, mesh);
    rooms_left_of({0, d}, {w, d}, 0, mesh), rooms_left_of({w, d}, {w, 0}, 0, mesh);
    rooms_left_of({c, c}, {x, c}, 0, mesh), rooms_left_of({x, c}, {x, y}, m, mesh);
    rooms_left_of({x, y}, {c, y}, 0, mesh), rooms_left_of({c, y}, {c, c}, m, mesh);
    for (const double end : {0.0, x})
      if (end != way_out) walls({{end, 0}, {end + c, 0}}, floor, floor + kCeiling, mesh);
    decks({-m - 1, -m - 1}, {w + m + 1, d + m + 1}, floor, floor + kCeiling, mesh);
    for (int i = 0; i < 10; ++i)  // bins, plants and copiers
      piece({furniture.uniform(3, w - 3), i % 2 ? 0.3 : d - 0.3}, {0.2, 0.2}, 0.7 + 0.07 * i, mesh);
  }

  void piece(const Vec2& center, const Vec2& half, double height, Mesh* mesh) {
    mesh->box(vec(center - half, floor), vec(center + half, floor + height), kMasonry);
  }

  void rooms_left_of(const Vec2& from, const Vec2& to, double bare, Mesh* mesh) {
    const double length = (to - from).norm();
    const Vec2 u = (to - from) / length, v(-u.y(), u.x());
    const auto at = [&](double along, double behind) -> Vec2 {
      return from + along * u + behind * v;
    };
    const auto upright = [&](const std::vector<Vec2>& line, double low, double high) {
      walls(line, floor + low, floor + high, mesh);
    };
    double built = 0;
    for (double edge = bare, next = 0; edge + 2.5 <= length - bare; edge = next) {
      next = edge + (irregular ? rooms.uniform(2.5, 7) : kRoom);
      if (next + 2.5 > length - bare) next = length - bare;
      const double width = next - edge, depth = irregular ? rooms.uniform(3, kDeepest) : 5;
      const double door = edge + (irregular ? rooms.uniform(0.3, width - kDoor - 0.3) : 1.5);
      upright({at(built, 0), at(door, 0)}, 0, kCeiling);
      built = door + kDoor;
      upright({at(door, 0), at(built, 0)}, kDoorTop, kCeiling);
      const bool closed = rooms.chance(kClosed) != changes.chance(changed);
      upright({at(door, 0), closed ? at(built, 0) : at(door, kDoor)}, 0, kDoorTop);
      upright({at(edge, 0), at(edge, depth), at(next, depth), at(next, 0)}, 0, kCeiling);
      for (int i = furniture.integer(1, 3); i > 0; --i) {
        Vec2 half(furniture.uniform(0.25, 0.8), 0.35), moved(0, 0);
        if (furniture.chance(0.5)) std::swap(half.x(), half.y());
        if (changes.chance(changed)) moved = {changes.normal(kMoved), changes.normal(kMoved)};
        const double along = edge + furniture.uniform(0.6, width - 0.6) + moved.x();
        const double behind = furniture.uniform(0.8, depth - 0.6) + moved.y();
        piece(at(along, std::max(0.8, behind)), half, furniture.uniform(0.7, 2), mesh);
      }
    }
    upright({at(built, 0), to}, 0, kCeiling);
  }
};

/// Around the middle of the corridor, from one of its corners.
Route around(double z, size_t first) {
  constexpr double m = kCorridor / 2, x = kLong - m, y = kBroad - m;
  const Route ring = {{m, m, z}, {x, m, z}, {x, y, z}, {m, y, z}};
  Route route;
  for (size_t i = first; i <= first + 4; ++i) route.push_back(ring[i % 4]);
  return route;
}

}  // namespace

Site make_office(uint64_t seed, bool irregular, double changed, double sway) {
  Site site;
  site.rounds.resize(2);
  Storey{seed, seed, irregular}.build(&site.rounds[0]);
  Storey{seed, seed, irregular, changed}.build(&site.rounds[1]);
  site.follow(around(0, 0), 0.25, sway, seed, 2);
  return site;
}

Site make_floors(uint64_t seed) {
  Site site;
  Mesh* const mesh = &site.mesh;
  constexpr double a = kCorridor, b = kLong - kCorridor, near = -kDeepest - 1,
                   far = near - kCorridor;
  Storey{seed, seed, false, 0, 0, 0}.build(mesh);
  Storey{seed, seed + 1, false, 0, kStorey, b}.build(mesh);  // equal but for the furniture
  // A ramp of 9 % beside the long side (garages: at most 15 %), and the ways to it.
  for (const double z : {0.0, kCeiling})
    mesh->quad(vec({a, far}, z), vec({b, far}, kStorey + z), vec({b, near}, kStorey + z),
               vec({a, near}, z), kMasonry);
  for (const double side : {near, far}) walls({{a, side}, {b, side}}, 0, kStorey + kCeiling, mesh);
  for (const auto& [outer, inner, z] : {std::array{0.0, a, 0.0}, {kLong, b, kStorey}}) {
    walls({{outer, 0}, {outer, far}, {inner, far}}, z, z + kCeiling, mesh);
    walls({{inner, near}, {inner, 0}}, z, z + kCeiling, mesh);
    decks({outer, far}, {inner, 0}, z, z + kCeiling, mesh);
  }
  constexpr double m = kCorridor / 2, y = (near + far) / 2;
  const Route up = {{m, y, 0}, {a, y, 0}, {b, y, kStorey}, {kLong - m, y, kStorey}};
  const Route down(up.rbegin(), up.rend());
  Route route;
  for (const Route& part : {around(0, 0), up, around(kStorey, 1), down, around(0, 0)})
    route.insert(route.end(), part.begin(), part.end());
  site.follow(route, 0.25, 0.3, seed);
  return site;
}

}  // namespace revisit::simulation
