#pragma once

#include <Eigen/Core>
#include <cmath>
#include <random>

#include "revisit/recognition/point_cloud.h"
#include "testing.h"

namespace revisit::test {

struct Lidar {
  int beams;
  double top, bottom;  // [deg]
};

/// A street between houses, or a tunnel if `roof` is below 4; distances in [m].
inline PointCloud street(const Lidar& lidar, double noise = 0, double wall = 8, double roof = 12) {
  constexpr double kHeight = 1.8, kMaxRange = 100;
  std::mt19937 random(5);
  std::normal_distribution<double> smear(0, 1);
  PointCloud cloud;
  for (int beam = 0; beam < lidar.beams; ++beam)
    for (int k = 0; k < 1000; ++k) {
      const double azimuth = (k + 0.5) * 0.36 * kDegree;
      const double share = beam / (lidar.beams - 1.0);
      const double elevation = (lidar.top + share * (lidar.bottom - lidar.top)) * kDegree;
      const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      double range = wall / std::abs(ray.y());
      if (ray.z() < 0) range = std::min(range, -kHeight / ray.z());
      Eigen::Vector3d p = range * ray;
      if (roof < 4 && ray.z() > 0) p = std::min(range, (roof - kHeight) / ray.z()) * ray;
      if (range > kMaxRange || p.z() > roof - kHeight + 1e-6) continue;
      p += noise * Eigen::Vector3d(smear(random), smear(random), smear(random));
      cloud.points.push_back(
          {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), 0});
    }
  return cloud;
}

}  // namespace revisit::test
