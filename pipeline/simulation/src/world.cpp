#include "world.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "objects.h"
#include "random.h"

namespace revisit::pipeline::simulation {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double kClearance = kRoadHalfWidth + 0.25;  // of everything, from any pose [m]
constexpr double kPavement = 1.4;                     // from the kerb to the front of a lot [m]
constexpr size_t kFrontPiece = 2;                     // of a closed front [path points]

/// Kinds of fence_line() that nobody looks through: boards, walls, hedges.
constexpr std::array<int, 6> kOpaque = {1, 2, 4, 5, 6, 7};

/// A piece of land beside the road: x along the road, y away from it, the origin in the
/// middle of its front.
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
          const Ground& ground)
      : seed_(seed), random_(seed, 0x746f776e), path_(path), roads_(roads), ground_(ground) {}

  World build() {
    ground_.build(path_, kWorldReach, &world_.mesh);
    world_.ground_triangles = world_.mesh.triangles.size();
    side_streets();
    lots();
    closed_fronts();
    close_side_streets();
    parked_cars();
    pavements();
    background();
    return std::move(world_);
  }

 private:
  double field(uint64_t which, const Vec2& p, double wavelength) const {
    return value_noise(seed_ ^ which, p.x(), p.y(), wavelength);
  }
  /// Side +1 is left of the path, -1 right. The lane for oncoming traffic is on the left.
  double lane_edge(int side) const { return side > 0 ? kOncomingOffset - 1 : 0; }
  Vec2 along(const PathPoint& p, int side) const { return side > 0 ? p.forward : Vec2(-p.forward); }

  /// Puts an object with its origin at `origin` if that keeps the road clear.
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

  // ---- streets nobody drives: gaps between the houses ----
  void side_streets() {
    size_t next = 60;
    for (size_t i = next; i < path_.size(); ++i) {
      if (i < next) continue;
      next = i + static_cast<size_t>(random_.uniform(120, 280) / kPathStep);
      const int side = random_.chance(0.5) ? 1 : -1;
      const PathPoint& p = path_[i];
      const Lot street{p.position + side * (lane_edge(side) + 3.4) * p.left(), along(p, side),
                       random_.uniform(5, 8), random_.uniform(35, 80)};
      if (!taken_.free(street.footprint())) continue;
      taken_.take(street.footprint());
      streets_.push_back(street);
    }
  }

  /// They are closed on both sides, too.
  void close_side_streets() {
    for (const Lot& street : streets_)
      for (const double x : {-street.width / 2, street.width / 2})
        fence_line(street.at(x, 4), street.away(), street.depth - 4, random_.uniform(1.6, 2.8),
                   opaque_kind());
  }

  // ---- houses and gardens along the road ----
  void lots() {
    std::array<double, 2> next = {0, 0};
    for (size_t i = 0; i < path_.size(); ++i) {
      const double s = static_cast<double>(i) * kPathStep;
      for (const int side : {1, -1}) {
        double& next_s = next[side > 0 ? 0 : 1];
        if (s < next_s) continue;
        const double used = lot_at(i, side);
        next_s = s + (used > 0 ? used : 2.0);
      }
    }
  }

  /// Builds one lot that begins at path point i; returns the length of road it took, 0 for none.
  double lot_at(size_t i, int side) {
    const PathPoint& start = path_[i];
    const double kerb = ground_.kerb(start.position);
    const double front = lane_edge(side) + kerb + kPavement;
    if (!taken_.free(Vec2(start.position + side * (front + 3) * start.left()))) return 0;

    const double density = field(0x64656e73, start.position, 130) + random_.uniform(-0.12, 0.12);
    const bool urban = density > 0.6, green = density < 0.2;
    const double width = urban   ? random_.uniform(8, 19)
                         : green ? random_.uniform(14, 28)
                                 : random_.uniform(13, 22);
    const double depth = urban ? random_.uniform(12, 16) : random_.uniform(15, 23);
    for (const double shrink : {1.0, 0.7, 0.4}) {
      const double w = std::max(6.0, width * shrink);
      const size_t middle = i + static_cast<size_t>(w / 2 / kPathStep);
      if (middle >= path_.size()) return 0;
      const PathPoint& p = path_[middle];
      if ((p.position - start.position).norm() > w) return 0;  // the path jumps
      for (int back = 0; back < 4; ++back) {
        const Lot lot{p.position + side * (front + 0.7 * back) * p.left(), along(p, side), w,
                      std::max(6.0, depth * shrink)};
        const Footprint land = lot.footprint();
        if (!roads_.clear(land, kerb + kPavement - 0.3) || !taken_.free(land)) continue;
        taken_.take(land);
        fill(lot, urban, green);
        return w + (urban && random_.chance(0.8) ? 0.0 : random_.uniform(0, 1.5));
      }
    }
    return 0;
  }

  /// Where no lot found room, a hedge, fence or wall stands beside the pavement: streets are closed
  /// on both sides, but for the side streets and crossings.
  void closed_fronts() {
    for (const int side : {1, -1})
      for (size_t i = 0; i + kFrontPiece < path_.size(); i += kFrontPiece) {
        const PathPoint& p = path_[i + kFrontPiece / 2];
        const double lateral = lane_edge(side) + ground_.kerb(p.position) + kPavement + 0.5;
        const Vec2 middle = p.position + side * lateral * p.left();
        const double length = static_cast<double>(kFrontPiece) * kPathStep;
        const Footprint front{middle, p.forward, {length / 2, 0.4}};
        if (!taken_.free(front) || !roads_.clear(front, kClearance)) continue;
        taken_.take(front);
        // One owner has one kind of fence.
        const double owner = field(0x66656e63, middle, 25);
        const int kind = kOpaque[static_cast<size_t>(owner * 997) % kOpaque.size()];
        fence_line(middle - length / 2 * p.forward, p.forward, length, 1.5 + owner, kind);
      }
  }

  void fill(const Lot& lot, bool urban, bool green) {
    if (lot.width < 7.5 || lot.depth < 11 || green) return garden(lot);
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
    const double y = kFacadeRelief + 0.5 + (random_.chance(0.3) ? random_.uniform(0, 2.5) : 0);
    BuildingStyle style;
    style.width = lot.width;
    style.depth = lot.depth - y - 0.5;
    style.floors = random_.integer(2, 5);
    style.floor_height = random_.uniform(2.8, 3.5);
    style.shop = random_.chance(0.3);
    house(lot, -lot.width / 2, y, style);
  }

  void villa(const Lot& lot) {
    const double y = random_.uniform(2.2, 5.5);
    BuildingStyle style;
    style.width = std::clamp(lot.width - random_.uniform(2, 7), 7.0, 16.0);
    style.depth = std::min(random_.uniform(8, 12), lot.depth - y - 1);
    style.floors = random_.integer(1, 3);
    const double free = lot.width - style.width;
    const double x = -lot.width / 2 + free * random_.uniform(0.15, 0.85);
    if (style.depth > 5) house(lot, x, y, style);
    const double gate = random_.uniform(-0.35, 0.35) * lot.width;
    boundary(lot, gate);
    // Between this house and the next: a garage, a fence, or a look into the garden.
    const double open = x + lot.width / 2;  // at the left
    const bool has_garage = open > 3.4 && random_.chance(0.5);
    if (!has_garage && open > 0.8 && random_.chance(0.9))
      fence_line(lot.at(-lot.width / 2, y + 0.5), lot.along, open - 0.4, random_.uniform(1.6, 2.4),
                 opaque_kind());
    const double right_end = x + style.width, open_right = lot.width / 2 - right_end;
    if (open_right > 0.8 && random_.chance(0.9))
      fence_line(lot.at(right_end + 0.2, y + 0.5), lot.along, open_right - 0.4,
                 random_.uniform(1.6, 2.4), opaque_kind());
    if (has_garage) {
      BuildingStyle garage;
      garage.width = std::min(open - 0.6, 3.6), garage.depth = 6, garage.floors = 1;
      garage.floor_height = 2.5, garage.detailed = false;
      house(lot, -lot.width / 2 + 0.3, y + random_.uniform(1, 3), garage);
    }
    if (random_.chance(0.6)) {
      const double right = lot.width / 2 - 0.3;
      const double length = random_.uniform(6, lot.depth - 2), height = random_.uniform(1.0, 1.9);
      fence_line(lot.at(right, 0.8), lot.away(), length, height, random_.integer(0, 6));
    }
    if (random_.chance(0.4)) car_at(lot.at(gate, 2.9), lot.away());
    plants(lot, 0.9, y - 0.6, random_.integer(2, 8), 0.2);
    plants(lot, y, lot.depth, random_.integer(2, 6), 0.6);
  }

  void garden(const Lot& lot) {
    boundary(lot, random_.uniform(-0.3, 0.3) * lot.width);
    const int count = static_cast<int>(lot.width * lot.depth / random_.uniform(9, 30));
    plants(lot, 1.2, lot.depth, count, 0.55);
    if (random_.chance(0.25) && lot.width > 9) {  // cars beside each other
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

  /// The line between lot and pavement, with a gate.
  void boundary(const Lot& lot, double gate) {
    const bool tall = random_.chance(0.6);
    const int kind = tall ? opaque_kind() : random_.integer(0, 7);
    const double height = tall ? random_.uniform(1.4, 2.4) : random_.uniform(0.7, 1.3);
    const double opening = random_.uniform(0.9, 3.0), y = 0.45, half = lot.width / 2 - 0.2;
    const double first = gate - opening / 2 + half, second = half - gate - opening / 2;
    if (first > 0.5) fence_line(lot.at(-half, y), lot.along, first, height, kind);
    if (second > 0.5) fence_line(lot.at(half, y), -lot.along, second, height, kind);
  }

  int opaque_kind() { return kOpaque[static_cast<size_t>(random_.integer(0, 5))]; }

  /// A hedge or fence from `from`, in pieces that follow the ground.
  void fence_line(const Vec2& from, const Vec2& direction, double length, double height, int kind) {
    const int pieces = std::max(1, static_cast<int>(std::ceil(length / 4)));
    const double piece = length / pieces, thick = random_.uniform(0.5, 0.9);
    for (int i = 0; i < pieces; ++i) {
      const Vec2 origin = from + i * piece * direction;
      const bool hedge = kind >= 4;
      const Mesh mesh = hedge ? make_hedge(random_, piece, height, thick)
                              : make_fence(random_, static_cast<FenceKind>(kind), piece, height);
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

  // ---- on the road and the pavement ----
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
    std::array<double, 2> next = {0, 0};
    for (size_t i = 0; i < path_.size(); ++i) {
      const double s = static_cast<double>(i) * kPathStep;
      const PathPoint& p = path_[i];
      for (const int side : {1, -1}) {
        double& next_s = next[side > 0 ? 0 : 1];
        if (s < next_s || !ground_.has_parking(p.position)) continue;
        const double lateral = lane_edge(side) + kClearance + 1.1 + random_.uniform(0, 0.12);
        const Vec2 center = p.position + side * lateral * p.left();
        const bool wanted = random_.chance(0.2 + 0.6 * field(0x63617273, center, 60));
        if (wanted && taken_.free(center)) {
          const double angle = random_.normal(0.02) + (random_.chance(0.15) ? 3.1416 : 0);
          car_at(center, Eigen::Rotation2Dd(angle) * along(p, -side));
        }
        next_s = s + random_.uniform(5.4, 6.4);
      }
    }
  }

  void pavements() {
    std::array<double, 2> next = {5, 17};
    for (size_t i = 0; i < path_.size(); ++i) {
      const double s = static_cast<double>(i) * kPathStep;
      const PathPoint& p = path_[i];
      for (const int side : {1, -1}) {
        double& next_s = next[side > 0 ? 0 : 1];
        if (s < next_s) continue;
        next_s = s + random_.uniform(6, 15);
        const double kerb = ground_.kerb(p.position), lateral = lane_edge(side) + kerb + 0.75;
        const Vec2 at = p.position + side * lateral * p.left();
        // One thing every few metres, also on a second visit.
        const Footprint around{at, p.forward, {2.6, 1.0}};
        if (!taken_.free(at) || !furniture_.free(around)) continue;
        const double kind = random_.uniform(),
                     crown = std::min(kerb + 0.75 - kClearance - 0.3, 2.4);
        const Vec2 to_road = -side * p.left();
        const Footprint small{at, p.forward, {0.75, 0.6}};
        bool done;
        if (kind < 0.28)
          done = put(make_lamp(random_), at, to_road, small);
        else if (kind < 0.48)
          done = put(make_sign(random_), at, random_.chance(0.5) ? p.forward : Vec2(-p.forward),
                     small);
        else if (kind < 0.75 && crown > 1.2)
          done = put_round(make_tree(random_, crown), at, crown + 0.3);
        else
          done = put(make_street_furniture(random_), at, p.forward, small);
        if (done) furniture_.take(around);
      }
    }
  }

  // ---- what is seen between and above the first row ----
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
          if (random_.chance(0.25 + 0.6 * field(0x64656e73, at, 130))) {
            BuildingStyle style;
            style.width = lot.width - 1, style.depth = lot.depth - 1;
            style.floors = random_.integer(1, 4), style.detailed = false;
            house(lot, -lot.width / 2 + 0.5, 0.5, style);
          } else {
            plants(lot, 0, lot.depth, random_.integer(2, 8), 0.6);
          }
        }
  }

  uint64_t seed_;
  Random random_;
  const std::vector<PathPoint>& path_;
  const RoadMap& roads_;
  const Ground& ground_;
  Occupancy taken_, cars_, furniture_;
  std::vector<Lot> streets_;  // nobody drives them
  World world_;
};

}  // namespace

World build_world(uint64_t seed, const std::vector<PathPoint>& path, const RoadMap& roads,
                  const Ground& ground) {
  return Builder(seed, path, roads, ground).build();
}

}  // namespace revisit::pipeline::simulation
