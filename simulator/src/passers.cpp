#include "passers.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "objects.h"
#include "random.h"

namespace revisit::simulation {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double kNearest = 1.5, kMaxRange = 9;        // distances of people [m]
constexpr double kCarReach = 20, kCarClearance = 2.2;  // from a car's center line to the sensor [m]
constexpr double kPersonRadius = 0.4;                  // [m]
constexpr int kTries = 30;

class PassersBuilder {
 public:
  PassersBuilder(uint64_t seed, const Vec2& sensor, const Ground& ground,
                 const std::vector<Footprint>& objects)
      : random_(seed, 0x70617373), sensor_(sensor), ground_(ground) {
    for (const Footprint& object : objects)
      if (object.distance(sensor) < kCarReach + 5) taken_.push_back(object);
  }

  void car(const std::vector<PathPoint>& path, size_t here) {
    for (int i = 0; i < kTries; ++i) {
      const bool oncoming = random_.chance(0.5);
      const double steps = random_.uniform(-kCarReach, kCarReach) / kPathStep;
      const double at = static_cast<double>(here) + steps;
      if (at < 0 || at >= static_cast<double>(path.size())) continue;
      const PathPoint& p = path[static_cast<size_t>(at)];
      const Vec2 middle = p.position + (oncoming ? kOncomingOffset : 0) * p.left();
      Vec2 half;
      const Mesh car = make_car(random_, &half);
      const Footprint footprint{middle, p.forward, half};
      if (footprint.distance(sensor_) < kCarClearance || !free(footprint)) continue;
      add(car, footprint, oncoming ? Vec2(-p.forward) : p.forward);
      ++result_.cars;
      return;
    }
  }

  void person() {
    for (int i = 0; i < kTries; ++i) {
      const double angle = random_.uniform(0, 2 * std::numbers::pi);
      const double distance = random_.uniform(kNearest, kMaxRange);
      const double walk = random_.uniform(0, 2 * std::numbers::pi);
      const Vec2 at = sensor_ + distance * Vec2(std::cos(angle), std::sin(angle));
      const Vec2 forward(std::cos(walk), std::sin(walk));
      const Footprint footprint{at, forward, {kPersonRadius, kPersonRadius}};
      if (!free(footprint)) continue;
      add(make_person(random_), footprint, forward);
      ++result_.people;
      return;
    }
  }

  Random& random() { return random_; }
  Passers take() { return std::move(result_); }

 private:
  bool free(const Footprint& footprint) const {
    return std::none_of(taken_.begin(), taken_.end(),
                        [&](const Footprint& other) { return other.overlaps(footprint); });
  }
  void add(const Mesh& object, const Footprint& footprint, const Vec2& forward) {
    const double z = ground_.surface_height(footprint.center);
    const Eigen::Vector3d origin(footprint.center.x(), footprint.center.y(), z);
    result_.mesh.append(object, {origin.cast<float>(), std::atan2(forward.y(), forward.x())});
    taken_.push_back(footprint);
  }

  Random random_;
  Vec2 sensor_;
  const Ground& ground_;
  std::vector<Footprint> taken_;
  Passers result_;
};

}  // namespace

Passers make_passers(uint64_t seed, const std::vector<PathPoint>& path, size_t here,
                     const Vec2& sensor, const Ground& ground,
                     const std::vector<Footprint>& objects) {
  PassersBuilder scene(seed, sensor, ground, objects);
  for (int i = 0, n = scene.random().integer(0, 2); i < n; ++i) scene.car(path, here);
  for (int i = 0, n = scene.random().integer(1, 4); i < n; ++i) scene.person();
  return scene.take();
}

}  // namespace revisit::simulation
