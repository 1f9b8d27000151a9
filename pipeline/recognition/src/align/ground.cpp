#include "align/ground.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace revisit {
namespace {

// Embankments, ditches and fields farther away are not the vehicle's ground.
constexpr float kReach = 10, kOwnVehicle = 2, kCell = 2;  // [m]
constexpr int kCellsAcross = 10;
static_assert(kCellsAcross * kCell == 2 * kReach);

std::vector<Eigen::Vector3d> low_points(const PointCloud& cloud) {
  constexpr size_t kMinSquares = 5, kLowest = 20;  // the lowest of 20 points: 5 %
  std::array<std::vector<Eigen::Vector3f>, kCellsAcross * kCellsAcross> cells;
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const float square = point.x * point.x + point.y * point.y;
    if (square <= kOwnVehicle * kOwnVehicle || square >= kReach * kReach) continue;
    const auto cell_of = [](float meters) {  // rounding may give kReach itself
      return std::min(static_cast<int>((meters + kReach) / kCell), kCellsAcross - 1);
    };
    const int row = cell_of(point.y), column = cell_of(point.x);
    cells[static_cast<size_t>(row * kCellsAcross + column)].emplace_back(point.x, point.y, point.z);
  }
  std::vector<Eigen::Vector3d> low;
  for (auto& cell : cells) {
    if (cell.size() < kMinSquares) continue;
    const auto middle = cell.begin() + static_cast<std::ptrdiff_t>(cell.size() / kLowest);
    std::ranges::nth_element(cell, middle, {}, [](const Eigen::Vector3f& p) { return p.z(); });
    low.push_back(middle->cast<double>());
  }
  return low;
}

/// Fits z = plane.x x + plane.y y + plane.z; `scale` decreases to the roughness of a road.
Eigen::Vector3d fit(const std::vector<Eigen::Vector3d>& points, double start) {
  constexpr int kRounds = 30;
  constexpr double kWide = 1, kRoad = 0.08, kNarrower = 0.8;
  Eigen::Vector3d plane(0, 0, start);
  double scale = kWide;
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3d squares = Eigen::Vector3d(1e-3, 1e-3, 1e-9).asDiagonal();
    Eigen::Vector3d products = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : points) {
      const Eigen::Vector3d row(p.x(), p.y(), 1);
      const double off = (p.z() - row.dot(plane)) / scale;
      const double weight = 1 / ((1 + off * off) * (1 + off * off));
      squares += weight * row * row.transpose();
      products += weight * p.z() * row;
    }
    plane = squares.inverse() * products;
    scale = std::max(kRoad, scale * kNarrower);
  }
  return plane;
}

}  // namespace

std::optional<Ground> find_ground(const PointCloud& cloud) {
  constexpr double kOnIt = 0.2;  // [m]
  constexpr size_t kMinCells = 12;
  static const double kSteepest = std::tan(20 * std::numbers::pi / 180);
  std::vector<Eigen::Vector3d> low = low_points(cloud);
  if (low.size() < kMinCells) return std::nullopt;
  const auto middle = low.begin() + static_cast<std::ptrdiff_t>(low.size() / 2);
  std::ranges::nth_element(low, middle, {}, [](const Eigen::Vector3d& p) { return p.z(); });
  const Eigen::Vector3d plane = fit(low, middle->z());
  const auto on_it = static_cast<size_t>(std::ranges::count_if(low, [&](const Eigen::Vector3d& p) {
    return std::abs(p.z() - plane.dot(Eigen::Vector3d(p.x(), p.y(), 1))) < kOnIt;
  }));
  if (on_it < std::max(kMinCells, low.size() / 3) || std::hypot(plane.x(), plane.y()) > kSteepest)
    return std::nullopt;
  const Eigen::Vector3d up = Eigen::Vector3d(-plane.x(), -plane.y(), 1).normalized();
  return Ground{up, -plane.z() * up.z()};
}

Eigen::Isometry3f T_level_sensor(const Ground& ground, double sensor_height) {
  const Eigen::Vector3d& up = ground.up;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  // Rodrigues' formula about up x z, which has length sin(angle); up.z() is cos(angle).
  Eigen::Matrix3d cross;
  cross << 0, 0, -up.x(), 0, 0, -up.y(), up.x(), up.y(), 0;
  T.linear() += cross + cross * cross / (1 + up.z());
  T.translation().z() = ground.sensor_height - sensor_height;
  return T.cast<float>();
}

PointCloud level(const PointCloud& cloud, double sensor_height) {
  // Smaller changes are scan-to-scan noise; correcting them would move beams between image rows.
  constexpr double kLevelHeight = 0.25;  // [m]
  static const double kLevelUp = std::cos(1.5 * std::numbers::pi / 180);
  const std::optional<Ground> ground = find_ground(cloud);
  Eigen::Isometry3f T = Eigen::Isometry3f::Identity();
  if (ground &&
      (ground->up.z() < kLevelUp || std::abs(ground->sensor_height - sensor_height) > kLevelHeight))
    T = T_level_sensor(*ground, sensor_height);
  const Eigen::Matrix3f R = T.linear();
  const Eigen::Vector3f t = T.translation();
  PointCloud leveled;
  leveled.points.reserve(cloud.points.size());
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    const Eigen::Vector3f p = R * Eigen::Vector3f(point.x, point.y, point.z) + t;
    leveled.points.push_back({p.x(), p.y(), p.z(), point.intensity});
  }
  return leveled;
}

}  // namespace revisit
