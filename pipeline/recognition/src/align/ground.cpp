#include "align/ground.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "align/facets.h"

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

/// Sum of squared distances from the middle in the horizontal direction where it is least [m^2].
double least_spread(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector3d& p : points) {
    sum += p.head<2>();
    squares += p.head<2>() * p.head<2>().transpose();
  }
  squares -= sum * sum.transpose() / static_cast<double>(points.size());
  const double middle = squares.trace() / 2;
  return middle - std::sqrt(std::max(0.0, middle * middle - squares.determinant()));
}

/// In buildings a wide ground is rarely seen: walls, floor and ceiling give the direction.
std::optional<Ground> ground_or_walls(const PointCloud& cloud, double sensor_height) {
  std::optional<Ground> ground = find_ground(cloud);
  if (ground && ground->is_wide) return ground;
  const std::optional<Ground> upright = find_upright(cloud, sensor_height);
  return upright ? upright : ground;
}

}  // namespace

std::optional<Ground> find_ground(const PointCloud& cloud) {
  constexpr double kOnIt = 0.2;       // [m]
  constexpr double kMinSpread = 250;  // [m^2]: roughness / sqrt(spread) is 0.3 degrees
  constexpr size_t kMinCells = 12;
  static const double kSteepest = std::tan(20 * std::numbers::pi / 180);
  std::vector<Eigen::Vector3d> low = low_points(cloud);
  if (low.size() < kMinCells) return std::nullopt;
  const auto middle = low.begin() + static_cast<std::ptrdiff_t>(low.size() / 2);
  std::ranges::nth_element(low, middle, {}, [](const Eigen::Vector3d& p) { return p.z(); });
  const Eigen::Vector3d plane = fit(low, middle->z());
  const size_t cells = low.size();
  std::erase_if(low, [&](const Eigen::Vector3d& p) {
    return std::abs(p.z() - plane.dot(Eigen::Vector3d(p.x(), p.y(), 1))) >= kOnIt;
  });
  if (low.size() < std::max(kMinCells, cells / 3) || std::hypot(plane.x(), plane.y()) > kSteepest)
    return std::nullopt;
  const Eigen::Vector3d up = Eigen::Vector3d(-plane.x(), -plane.y(), 1).normalized();
  return Ground{up, -plane.z() * up.z(), 2 * low.size() > cells && least_spread(low) > kMinSpread};
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

PointCloud level(const PointCloud& cloud, double sensor_height, bool shows_ground) {
  // Smaller changes are scan-to-scan noise; correcting them would move beams between image rows.
  constexpr double kLevelHeight = 0.25;  // [m]
  static const double kLevelUp = std::cos(1.5 * std::numbers::pi / 180);
  const std::optional<Ground> ground =
      shows_ground ? ground_or_walls(cloud, sensor_height) : find_upright(cloud, sensor_height);
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
