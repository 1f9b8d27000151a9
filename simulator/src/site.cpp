#include "site.h"

#include <cmath>

#include "random.h"

namespace revisit::simulation {
namespace {

constexpr double kFrameStep = 0.1;          // 1 m/s [m]
constexpr double kTurnSpeed = 9 * kDegree;  // per frame; 90 deg/s
constexpr double kSteepest = 0.2;           // slope of a ramp; steeper are stairs
constexpr double kStride = 0.7, kWandering = 9, kNoise = 0.44;  // wavelengths [m], deviation

}  // namespace

void Site::follow(const Route& route, double wander, double sway, uint64_t seed, size_t count) {
  double s = 0, yaw = 0;
  const auto noise = [&](uint64_t purpose, double wavelength) {  // smooth, in [-1, 1]
    return 2 * value_noise(random_bits(seed, purpose), s, 0, wavelength) - 1;
  };
  const auto stand = [&](const Eigen::Vector3d& point, double slope, size_t round) {
    const double sigma = sway * kDegree / kNoise, aside = wander * noise(1, kWandering);
    const double pitch = sigma * noise(2, kStride) - (std::abs(slope) < kSteepest ? slope : 0);
    Pose T(Eigen::Translation3d(point) * Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
           Eigen::Translation3d(0, aside, 0));
    T.rotate(Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
             Eigen::AngleAxisd(sigma * noise(3, kStride), Eigen::Vector3d::UnitX()));
    T_site_floor.push_back(T);
    round_of.push_back(round);
  };
  for (size_t round = 0; round < count; ++round)
    for (size_t leg = 0; leg + 1 < route.size(); ++leg) {
      const Eigen::Vector3d way = route[leg + 1] - route[leg];
      const double heading = std::atan2(way.y(), way.x()), slope = way.z() / way.head<2>().norm();
      const double turn = T_site_floor.empty() ? 0 : std::remainder(heading - yaw, 360 * kDegree);
      const int turning = static_cast<int>(std::abs(turn) / kTurnSpeed);
      for (int i = 0; i < turning; ++i, yaw += turn / turning) stand(route[leg], 0, round);
      yaw = heading;
      const int n = static_cast<int>(std::ceil(way.norm() / kFrameStep));
      for (int i = 0; i < n; ++i, s += kFrameStep) stand(route[leg] + way * i / n, slope, round);
    }
}

Route there_and_back(Route route) {
  const Route back(route.rbegin() + 1, route.rend());
  route.insert(route.end(), back.begin(), back.end());
  return route;
}

Mesh::Vec vec(const Vec2& point, double z) {
  return {f(point.x()), f(point.y()), f(z)};
}

void walls(const std::vector<Vec2>& line, double low, double high, Mesh* mesh) {
  for (size_t i = 0; i + 1 < line.size(); ++i)
    mesh->quad(vec(line[i], low), vec(line[i + 1], low), vec(line[i + 1], high), vec(line[i], high),
               kMasonry);
}

void decks(const Vec2& a, const Vec2& b, double low, double high, Mesh* mesh) {
  for (const double z : {low, high})
    mesh->quad(vec(a, z), vec({b.x(), a.y()}, z), vec(b, z), vec({a.x(), b.y()}, z), kMasonry);
}

}  // namespace revisit::simulation
