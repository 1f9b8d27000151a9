#include "traffic.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "objects.h"
#include "random.h"

namespace revisit::simulation {

namespace {

constexpr double kOwnSpace = 7;     // minimum distance of cars to the ego vehicle [m]
constexpr double kLeaderTerm = 25;  // duration of a leading car, or of its absence [s]
constexpr size_t kModels = 12;

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

Traffic::Traffic(uint64_t seed, const std::vector<PathPoint>& path, const Ground& ground,
                 const Scenery& scenery, double share)
    : seed_(seed),
      path_(path),
      ground_(ground),
      scenery_(scenery),
      leader_(static_cast<float>(scenery.leader * share)) {
  Random random(seed, 0x74726166);
  for (size_t i = 0; i < kModels; ++i) {
    Eigen::Vector2d half;
    models_.push_back(i < scenery.trucks ? make_truck(random) : make_car(random, &half));
  }
  if (scenery.oncoming_spacing == 0) return;
  const double length = static_cast<double>(path.size()) * kPathStep;
  const int count = static_cast<int>(length / scenery.oncoming_spacing * share);
  for (int i = 0; i < count; ++i) {
    const double start = random.uniform(0, length),
                 speed = random.uniform(scenery.oncoming_speed.low, scenery.oncoming_speed.high);
    oncoming_.push_back({start, speed, static_cast<size_t>(random.integer(0, kModels - 1))});
  }
}

Mesh Traffic::at(double time, size_t ego, double reach) const {
  Mesh mesh;
  const Eigen::Vector2d here = path_[ego].position;
  const double length = static_cast<double>(path_.size()) * kPathStep;
  for (const Oncoming& car : oncoming_) {
    double s = std::fmod(car.start - car.speed * time, length);
    if (s < 0) s += length;
    place(car.model, s, scenery_.oncoming, true, here, reach, &mesh);
  }
  const auto term = static_cast<uint64_t>(time / kLeaderTerm);
  const uint64_t bits = random_bits(seed_, 0x6c656164, term);
  if (unit_float(bits) < leader_) {
    const double gap = 12 + 14 * value_noise(seed_ ^ 0x676170, time, 0, 12);
    place(bits % kModels, static_cast<double>(ego) * kPathStep + gap, 0, false, here, reach, &mesh);
  }
  return mesh;
}

void Traffic::place(size_t model, double s, double to_left, bool against,
                    const Eigen::Vector2d& ego, double reach, Mesh* mesh) const {
  const auto i = static_cast<size_t>(s / kPathStep);
  if (i + 1 >= path_.size()) return;
  const double t = s / kPathStep - static_cast<double>(i);
  const PathPoint& p = path_[i];
  const Eigen::Vector2d step = path_[i + 1].position - p.position;
  if (step.norm() > 2 * kPathStep) return;  // gap between two pieces of the path
  const Eigen::Vector2d position = p.position + t * step + to_left * p.left();
  const double distance = (position - ego).norm();
  // Avoids collisions with the ego vehicle; oncoming cars pass at the lane's distance.
  if (distance > reach || distance < (against ? scenery_.oncoming * 0.8 : kOwnSpace)) return;
  const Eigen::Vector2d forward = against ? Eigen::Vector2d(-p.forward) : p.forward;
  mesh->append(models_[model],
               {Eigen::Vector3d(position.x(), position.y(), ground_.height(position)).cast<float>(),
                std::atan2(forward.y(), forward.x())},
               static_cast<uint32_t>(model));
}

Passers make_passers(uint64_t seed, const std::vector<PathPoint>& path, size_t here,
                     const Vec2& sensor, const Ground& ground,
                     const std::vector<Footprint>& objects) {
  PassersBuilder scene(seed, sensor, ground, objects);
  for (int i = 0, n = scene.random().integer(0, 2); i < n; ++i) scene.car(path, here);
  for (int i = 0, n = scene.random().integer(1, 4); i < n; ++i) scene.person();
  return scene.take();
}

}  // namespace revisit::simulation
