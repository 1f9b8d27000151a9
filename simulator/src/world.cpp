#include "world.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "objects.h"
#include "random.h"
#include "scenery.h"

namespace revisit::simulation {
namespace {

constexpr double kClearance = kRoadHalfWidth + 0.25;  // [m]
constexpr size_t kFrontPiece = 2;                     // [path points]

constexpr std::array<FenceKind, 8> kAnyFence = {
    FenceKind::kSlats, FenceKind::kBoards, FenceKind::kWall,  FenceKind::kRailing,
    FenceKind::kHedge, FenceKind::kHedge,  FenceKind::kHedge, FenceKind::kHedge};

/// A lot beside the road: x along the road, y away from it, origin in the middle of its front.
struct Lot {
  Vec2 origin, along;
  double width, depth;
  Vec2 away() const { return {-along.y(), along.x()}; }
  Vec2 at(double x, double y) const { return origin + x * along + y * away(); }
  Footprint footprint() const { return {at(0, depth / 2), along, {width / 2, depth / 2}}; }
};

class Builder {
 public:
  Builder(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
          const Ground& ground, const Scenery& scenery)
      : seed_(seed),
        random_(seed, 0x746f776e),
        path_(path),
        roads_(roads),
        ground_(ground),
        scenery_(scenery) {}

  World build() {
    ground_.build(path_, kWorldReach, &world_.mesh);
    world_.ground_triangles = world_.mesh.triangles.size();
    side_streets();
    lots();
    for (const RoadsideLine& line : scenery_.lines) roadside_line(line);
    close_side_streets();
    parked_cars();
    rows_of_cars();
    things();
    woods();
    background();
    return std::move(world_);
  }

 private:
  double field(uint64_t which, const Vec2& p, double wavelength) const {
    return value_noise(seed_ ^ which, p.x(), p.y(), wavelength);
  }
  double density(const Vec2& p) const { return field(0x64656e73, p, 130); }
  static double by(const Range& chances, double field) {
    return chances.low + (chances.high - chances.low) * field;
  }
  double draw(const Range& range) { return random_.uniform(range.low, range.high); }
  int draw(const Count& count) { return random_.integer(count.low, count.high); }
  /// Side +1 is left of the path, -1 right. The lane for oncoming traffic is on the left.
  double lane_edge(int side) const { return side > 0 ? scenery_.oncoming - 1 : 0; }
  Vec2 along(const PathPoint& p, int side) const { return side > 0 ? p.forward : Vec2(-p.forward); }

  /// Repeats the random numbers of `purpose` if all objects are equal.
  template <class Build>
  void alike(uint64_t purpose, const Build& build) {
    const Random others = random_;
    if (scenery_.equal) random_ = Random(seed_, purpose);
    build();
    if (scenery_.equal) random_ = others;
  }

  bool put(const Mesh& object, const Vec2& origin, const Vec2& x_axis, const Footprint& footprint) {
    if (!roads_.clear(footprint, kClearance)) return false;
    const double z = ground_.surface_height(origin);
    world_.mesh.append(object, {Eigen::Vector3d(origin.x(), origin.y(), z).cast<float>(),
                                std::atan2(x_axis.y(), x_axis.x())});
    world_.objects.push_back(footprint);
    return true;
  }
  bool put_round(const Mesh& object, const Vec2& origin, double radius) {
    const double angle = random_.uniform(0, 6.283);
    return put(object, origin, {std::cos(angle), std::sin(angle)},
               {origin, {1, 0}, {radius, radius}});
  }

  /// Calls build(path point, side), first at `next` [m]; build() returns the distance to the next.
  template <class Build>
  void along_both_sides(std::array<double, 2> next, const Build& build) {
    for (size_t i = 0; i < path_.size(); ++i) {
      const double s = static_cast<double>(i) * kPathStep;
      for (const int side : {1, -1})
        if (double& next_s = next[side > 0 ? 0 : 1]; s >= next_s) next_s = s + build(i, side);
    }
  }

  void side_streets() {
    if (scenery_.side_streets.high == 0) return;
    size_t next = 60;
    for (size_t i = next; i < path_.size(); ++i) {
      if (i < next) continue;
      next = i + static_cast<size_t>(draw(scenery_.side_streets) / kPathStep);
      const int side = random_.chance(0.5) ? 1 : -1;
      const PathPoint& p = path_[i];
      const Lot street{p.position + side * (lane_edge(side) + 3.4) * p.left(), along(p, side),
                       draw(scenery_.side_street_width), random_.uniform(35, 80)};
      if (!taken_.free(street.footprint())) continue;
      taken_.take(street.footprint());
      streets_.push_back(street);
    }
  }

  void close_side_streets() {
    for (const Lot& street : streets_)
      for (const double x : {-street.width / 2, street.width / 2})
        fence_line(street.at(x, 4), street.away(), street.depth - 4, random_.uniform(1.6, 2.8),
                   tall_fence());
  }

  void lots() {
    along_both_sides({0, 0}, [&](size_t i, int side) {
      const double used = lot_at(i, side);
      return used > 0 ? used : 2.0;
    });
  }

  /// Lot that begins at path point i; returns the length of road it took, or 0.
  double lot_at(size_t i, int side) {
    const PathPoint& start = path_[i];
    const double kerb = ground_.kerb(start.position);
    const double front = lane_edge(side) + kerb + scenery_.front;
    if (!taken_.free(Vec2(start.position + side * (front + 3) * start.left()))) return 0;

    const double built = density(start.position) + random_.uniform(-0.12, 0.12);
    if (built < scenery_.open_below) return 0;
    const bool urban = built > scenery_.urban_above, green = built < scenery_.green_below;
    const double width = draw(urban   ? scenery_.urban_width
                              : green ? scenery_.green_width
                                      : scenery_.villa_width);
    const double depth = draw(urban ? scenery_.urban_depth : scenery_.other_depth);
    for (const double shrink : {1.0, 0.7, 0.4}) {
      const double w = std::max(6.0, width * shrink);
      const size_t middle = i + static_cast<size_t>(w / 2 / kPathStep);
      if (middle >= path_.size()) return 0;
      const PathPoint& p = path_[middle];
      if ((p.position - start.position).norm() > w) return 0;  // gap in the path
      for (int back = 0; back < 4; ++back) {
        const Lot lot{p.position + side * (front + 0.7 * back) * p.left(), along(p, side), w,
                      std::max(6.0, depth * shrink)};
        const Footprint land = lot.footprint();
        if (!roads_.clear(land, kerb + scenery_.front - 0.3) || !taken_.free(land)) continue;
        taken_.take(land);
        alike(0x6c6f7473, [&] { fill(lot, urban, green); });
        const bool touches = scenery_.equal || (urban && random_.chance(scenery_.gapless));
        return w + (touches ? 0.0 : random_.uniform(0, 1.5));
      }
    }
    return 0;
  }

  /// Closes streets on both sides where there is no lot, except at side streets and crossings.
  void roadside_line(const RoadsideLine& line) {
    if (line.below == 0) return;
    for (const int side : {1, -1}) {
      if (side < 0 && line.left_only) continue;
      for (size_t i = 0; i + kFrontPiece < path_.size(); i += kFrontPiece) {
        const auto at = [&](size_t point) {
          const PathPoint& p = path_[point];
          const double lateral = lane_edge(side) + ground_.kerb(p.position) + line.beyond_kerb;
          return Vec2(p.position + side * lateral * p.left());
        };
        const Vec2 middle = at(i + kFrontPiece / 2);
        Vec2 direction = path_[i + kFrontPiece / 2].forward;
        double length = static_cast<double>(kFrontPiece) * kPathStep;
        Footprint front{middle, direction, {length / 2, 0.4}};
        if (line.joined) {
          const Vec2 piece = at(i + kFrontPiece) - at(i);
          length = piece.norm();
          if (length < 0.1 || length > 5) continue;  // the path turns on the spot or has a gap
          direction = piece / length;
          // Wide enough to overlap the line of another pass, short enough not to overlap its own.
          front = {middle, direction, {0.3 * length, 0.9}};
        }
        if (field(0x73686172, middle, line.owner) >= line.below) continue;
        if (!taken_.free(front) ||
            !roads_.clear({middle, direction, {length / 2, 0.4}}, kClearance))
          continue;
        taken_.take(front);
        const double owner = field(0x66656e63, middle, line.owner);
        const auto kind = static_cast<size_t>(owner * line.kinds_an_owner) % line.kinds.size();
        fence_line(middle - length / 2 * direction, direction, length, by(line.height, owner),
                   line.kinds[kind]);
      }
    }
  }

  void fill(const Lot& lot, bool urban, bool green) {
    if (lot.width < scenery_.smallest_width || lot.depth < scenery_.smallest_depth || green)
      return garden(lot);
    if (urban) return town_house(lot);
    villa(lot);
  }

  bool house(const Lot& lot, double x, double y, const BuildingStyle& style) {
    const Vec2 origin = lot.at(x, y);
    const Footprint stands{lot.at(x + style.width / 2, y + style.depth / 2 - kFacadeRelief / 2),
                           lot.along,
                           {style.width / 2 + 0.5, (style.depth + kFacadeRelief) / 2 + 0.5}};
    return put(make_building(random_, style), origin, lot.along, stands);
  }

  void town_house(const Lot& lot) {
    const double y =
        kFacadeRelief + 0.5 + (random_.chance(scenery_.recessed) ? random_.uniform(0, 2.5) : 0);
    BuildingStyle style;
    style.width = lot.width;
    style.depth = lot.depth - y - 0.5;
    style.floors = draw(scenery_.urban_floors);
    style.floor_height = random_.uniform(2.8, 3.5);
    style.shop = random_.chance(scenery_.shops);
    house(lot, -lot.width / 2, y, style);
  }

  void villa(const Lot& lot) {
    const double y = draw(scenery_.setback);
    BuildingStyle style;
    style.width = std::clamp(lot.width - draw(scenery_.beside), 7.0, 16.0);
    style.depth = std::min(random_.uniform(8, 12), lot.depth - y - 1);
    style.floors = draw(scenery_.villa_floors);
    const double free = lot.width - style.width;
    const double x = -lot.width / 2 + free * random_.uniform(0.15, 0.85);
    if (style.depth > 5) house(lot, x, y, style);
    const double gate = random_.uniform(-0.35, 0.35) * lot.width;
    boundary(lot, gate);
    const double open = x + lot.width / 2;  // on the left
    const bool has_garage = open > 3.4 && random_.chance(0.5);
    if (!has_garage && open > 0.8 && random_.chance(scenery_.closed))
      fence_line(lot.at(-lot.width / 2, y + 0.5), lot.along, open - 0.4, random_.uniform(1.6, 2.4),
                 tall_fence());
    const double right_end = x + style.width, open_right = lot.width / 2 - right_end;
    if (open_right > 0.8 && random_.chance(scenery_.closed))
      fence_line(lot.at(right_end + 0.2, y + 0.5), lot.along, open_right - 0.4,
                 random_.uniform(1.6, 2.4), tall_fence());
    if (has_garage) {
      BuildingStyle garage;
      garage.width = std::min(open - 0.6, 3.6), garage.depth = 6, garage.floors = 1;
      garage.floor_height = 2.5, garage.detailed = false;
      house(lot, -lot.width / 2 + 0.3, y + random_.uniform(1, 3), garage);
    }
    if (random_.chance(0.6)) {
      const double right = lot.width / 2 - 0.3;
      const double length = random_.uniform(6, lot.depth - 2), height = random_.uniform(1.0, 1.9);
      fence_line(lot.at(right, 0.8), lot.away(), length, height, any_fence(6));
    }
    if (random_.chance(0.4)) car_at(lot.at(gate, 2.9), lot.away());
    plants(lot, 0.9, y - 0.6, draw(scenery_.plants_before), 0.2);
    plants(lot, y, lot.depth, draw(scenery_.plants_behind), 0.6);
  }

  void garden(const Lot& lot) {
    boundary(lot, random_.uniform(-0.3, 0.3) * lot.width);
    const int count = static_cast<int>(lot.width * lot.depth / random_.uniform(9, 30));
    plants(lot, 1.2, lot.depth, count, 0.55);
    if (random_.chance(0.25) && lot.width > 9) {
      for (double x = -lot.width / 2 + 2; x + 2 < lot.width / 2; x += 2.6)
        if (random_.chance(0.6)) car_at(lot.at(x, 4), lot.away());
    } else if (random_.chance(0.3) && lot.width > 7) {
      BuildingStyle shed;
      shed.width = random_.uniform(2.5, 5), shed.depth = random_.uniform(2.5, 4), shed.floors = 1;
      shed.floor_height = random_.uniform(2, 2.6), shed.detailed = false;
      house(lot, random_.uniform(-lot.width / 2 + 0.6, lot.width / 2 - 5.6),
            random_.uniform(1.5, 2), shed);
    }
  }

  void boundary(const Lot& lot, double gate) {
    const bool tall = random_.chance(scenery_.tall_fences);
    const FenceKind kind = tall ? tall_fence() : any_fence(7);
    const double height = tall ? random_.uniform(1.4, 2.4) : random_.uniform(0.7, 1.3);
    const double opening = random_.uniform(0.9, 3.0), y = 0.45, half = lot.width / 2 - 0.2;
    const double first = gate - opening / 2 + half, second = half - gate - opening / 2;
    if (first > 0.5) fence_line(lot.at(-half, y), lot.along, first, height, kind);
    if (second > 0.5) fence_line(lot.at(half, y), -lot.along, second, height, kind);
  }

  FenceKind tall_fence() { return scenery_.fences[static_cast<size_t>(random_.integer(0, 5))]; }
  FenceKind any_fence(int last) { return kAnyFence[static_cast<size_t>(random_.integer(0, last))]; }

  /// Adds pieces that follow the ground.
  void fence_line(const Vec2& from, const Vec2& direction, double length, double height,
                  FenceKind kind) {
    const int pieces = std::max(1, static_cast<int>(std::ceil(length / 4)));
    const double piece = length / pieces, thick = random_.uniform(0.5, 0.9);
    for (int i = 0; i < pieces; ++i) {
      const Vec2 origin = from + i * piece * direction;
      const bool hedge = kind == FenceKind::kHedge;
      const Mesh mesh = hedge ? make_hedge(random_, piece, height, thick)
                              : make_fence(random_, kind, piece, height);
      put(mesh, origin, direction,
          {origin + piece / 2 * direction,
           direction,
           {piece / 2 + 0.2, hedge ? thick / 2 + 0.2 : 0.25}});
    }
  }

  void plants(const Lot& lot, double y0, double y1, int count, double trees) {
    if (y1 <= y0) return;
    for (int i = 0; i < count; ++i) {
      const double x = random_.uniform(-0.47, 0.47) * lot.width;
      const Vec2 p = lot.at(x, random_.uniform(y0, y1));
      if (random_.chance(trees)) {
        const double crown = random_.uniform(1.2, 3.2);
        put_round(make_tree(random_, crown), p, crown + 0.3);
      } else {
        const double radius = random_.uniform(0.4, 1.1);
        put_round(make_bush(random_, radius, random_.uniform(0.6, 2.2)), p, radius + 0.3);
      }
    }
  }

  bool car_at(const Vec2& center, const Vec2& forward) {
    Vec2 half;
    const Mesh car = make_car(random_, &half);
    const Footprint footprint{center, forward, half + Vec2(0.1, 0.05)};
    if (!cars_.free(footprint)) return false;
    if (!put(car, center, forward, footprint)) return false;
    cars_.take(footprint);
    return true;
  }

  void parked_cars() {
    along_both_sides({0, 0}, [&](size_t i, int side) {
      const PathPoint& p = path_[i];
      if (!ground_.has_parking(p.position)) return 0.0;
      const double lateral = lane_edge(side) + kClearance + 1.1 + random_.uniform(0, 0.12);
      const Vec2 center = p.position + side * lateral * p.left();
      const bool wanted = random_.chance(by(scenery_.parked, field(0x63617273, center, 60)));
      if (wanted && taken_.free(center)) {
        const double angle = random_.normal(0.02) + (random_.chance(0.15) ? 3.1416 : 0);
        car_at(center, Eigen::Rotation2Dd(angle) * along(p, -side));
      }
      return random_.uniform(5.4, 6.4);
    });
  }

  /// An empty slot stays empty when the road passes again.
  void rows_of_cars() {
    constexpr double kSlot = 2.6, kDepth = 5.2;  // [m]
    for (const double row : scenery_.rows) {
      if (row == 0) continue;
      for (double s = 0; s < static_cast<double>(path_.size()) * kPathStep; s += kSlot) {
        const PathPoint& p = path_[static_cast<size_t>(s / kPathStep)];
        for (const int side : {1, -1}) {
          const double lateral = lane_edge(side) + ground_.kerb(p.position) + row;
          const Vec2 center = p.position + side * lateral * p.left();
          const Footprint slot{center, p.left(), {kDepth / 2, kSlot / 2 - 0.1}};
          if (!taken_.free(slot) || !roads_.clear(slot, kClearance)) continue;
          taken_.take(slot);
          if (random_.chance(by(scenery_.row_cars, field(0x63617273, center, 40))))
            car_at(center, random_.chance(0.5) ? p.left() : Vec2(-p.left()));
        }
      }
    }
  }

  void things() {
    along_both_sides({5, 17}, [&](size_t i, int side) {
      const double to_next = draw(scenery_.things);
      const PathPoint& p = path_[i];
      const double kerb = ground_.kerb(p.position),
                   lateral = lane_edge(side) + kerb + scenery_.verge;
      const Vec2 at = p.position + side * lateral * p.left();
      // One object every few meters, also on a second visit.
      const Footprint around{at, p.forward, {2.6, 1.0}};
      if (!taken_.free(at) || !furniture_.free(around)) return to_next;
      const double crown = std::min(kerb + scenery_.verge - kClearance - 0.3, 2.4);
      bool done = false;
      alike(0x7468696e, [&] { done = thing(p, side, at, crown); });
      if (done) furniture_.take(around);
      return to_next;
    });
  }

  /// Returns false without space. `crown` is the maximum crown radius of a tree [m].
  bool thing(const PathPoint& p, int side, const Vec2& at, double crown) {
    const double kind = random_.uniform();
    const Vec2 to_road = -side * p.left();
    const Footprint small{at, p.forward, {0.75, 0.6}};
    double until = scenery_.boards;
    if (kind < until)
      return put(make_board(random_), at, along(p, side), {at, p.forward, {0.75, 1.9}});
    if (kind < (until += scenery_.posts)) return put(make_post(random_), at, to_road, small);
    if (kind < (until += scenery_.lamps)) return put(make_lamp(random_), at, to_road, small);
    if (kind < (until += scenery_.signs))
      return put(make_sign(random_), at, random_.chance(0.5) ? p.forward : Vec2(-p.forward), small);
    if (kind < until + scenery_.trees && crown > 1.2)
      return put_round(make_tree(random_, crown), at, crown + 0.3);
    return put(make_street_furniture(random_), at, p.forward, small);
  }

  void woods() {
    if (scenery_.wood.high == 0) return;
    for (size_t i = 0; i < path_.size(); i += 9)
      for (const int side : {1, -1})
        for (double beyond = scenery_.wood.low; beyond < scenery_.wood.high; beyond += 4.5) {
          const PathPoint& p = path_[i];
          const double lateral = lane_edge(side) + ground_.kerb(p.position) + beyond;
          const Vec2 middle = p.position + side * lateral * p.left();
          if (field(0x776f6f64, middle, 110) < scenery_.wood_above) continue;
          const Vec2 at = middle + Vec2(random_.uniform(-1.6, 1.6), random_.uniform(-1.6, 1.6));
          const Footprint trunk{at, {1, 0}, {1.7, 1.7}};
          if (!taken_.free(trunk)) continue;
          const double crown = random_.uniform(1.8, 3.4);
          if (put_round(make_tree(random_, crown), at, crown + 0.3)) taken_.take(trunk);
        }
  }

  void background() {
    for (size_t i = 0; i < path_.size(); i += 12)
      for (const int side : {1, -1})
        for (const double lateral : {30.0, 47.0, 68.0, 92.0}) {
          const PathPoint& p = path_[i];
          const Vec2 at = p.position + side * (lateral + random_.uniform(-5, 5)) * p.left();
          const Eigen::Rotation2Dd turn(random_.normal(0.15));
          const Lot lot{at, turn * along(p, side), random_.uniform(9, 22), random_.uniform(9, 14)};
          const Footprint land = lot.footprint();
          if (!taken_.free(land) || !roads_.clear(land, 9)) continue;
          taken_.take(land);
          if (random_.chance(by(scenery_.far_houses, density(at)))) {
            BuildingStyle style;
            style.width = lot.width - 1, style.depth = lot.depth - 1;
            style.floors = draw(scenery_.far_floors), style.detailed = false;
            house(lot, -lot.width / 2 + 0.5, 0.5, style);
          } else {
            plants(lot, 0, lot.depth, draw(scenery_.far_plants), scenery_.far_trees);
          }
        }
  }

  uint64_t seed_;
  Random random_;
  const std::vector<PathPoint>& path_;
  const RoadMap& roads_;
  const Ground& ground_;
  const Scenery& scenery_;
  Occupancy taken_, cars_, furniture_;
  std::vector<Lot> streets_;
  World world_;
};

}  // namespace

World build_world(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
                  const Ground& ground, const Scenery& scenery) {
  return Builder(seed, path, roads, ground, scenery).build();
}

}  // namespace revisit::simulation
