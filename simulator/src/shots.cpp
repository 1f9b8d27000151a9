#include "shots.h"

#include <cmath>
#include <numbers>

#include "random.h"

namespace revisit::simulation {
namespace {

constexpr double kTurn = 40 * kDegree, kTurnError = 3 * kDegree;
constexpr double kTilt = 0.5 * kDegree;  // tilt of a tripod leveled by eye
constexpr double kFromLane = 0.8;  // [m], distance of the tripod to the right of the driven lane

Vec2 in_disc(Random& random, double radius) {
  const double angle = random.uniform(0, 2 * std::numbers::pi);
  const double r = radius * std::sqrt(random.uniform());
  return {r * std::cos(angle), r * std::sin(angle)};
}

}  // namespace

std::vector<int> shots_per_place(bool objects) {
  if (!objects) return std::vector<int>(kPlaces, 11);
  return {14, 14, 14, 13, 13, 13, 13};
}

std::vector<Shot> plan_shots(bool objects, uint64_t seed, const std::vector<PathPoint>& path,
                             const Ground& ground) {
  const std::vector<int> counts = shots_per_place(objects);
  std::vector<Shot> shots;
  for (int place = 0; place < kPlaces; ++place) {
    // The route is one round of a block and 0.6 of another.
    const double s = (place + 0.5) * kPlaceRoute / 1.6 / kPlaces;
    const auto point = static_cast<size_t>(s / kPathStep);
    const PathPoint& p = path.at(point);
    const Vec2 middle = p.position - kFromLane * p.left();
    Random random(seed, random_bits(0x74726970, static_cast<uint64_t>(place),
                                    static_cast<uint64_t>(objects)));
    const double lean = random.uniform(0, 2 * std::numbers::pi);
    const Eigen::AngleAxisd tilt(random.normal(kTilt),
                                 Eigen::Vector3d(std::cos(lean), std::sin(lean), 0));
    double yaw = random.uniform(0, 2 * std::numbers::pi);
    Vec2 stand = middle + in_disc(random, kPlaceRadius);
    for (int number = 0; number < counts[static_cast<size_t>(place)]; ++number) {
      if (!objects && number > 0) {
        yaw += kTurn + random.normal(kTurnError);
        stand = middle + in_disc(random, kPlaceRadius);
      }
      Shot shot{place, number, Pose::Identity(), point};
      shot.T_town_velo.linear() =
          (tilt * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())).toRotationMatrix();
      shot.T_town_velo.translation() =
          Eigen::Vector3d(stand.x(), stand.y(), ground.surface_height(stand) + kTripodHeight);
      shots.push_back(shot);
    }
  }
  return shots;
}

}  // namespace revisit::simulation
