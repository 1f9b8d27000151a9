#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "prepared_scan.h"

namespace revisit {
namespace {

constexpr double kCell = 0.5;  // [m]

/// Top-down grid: occupied cells have the value 3, neighbors 2 and 1, so that near misses count.
class Cells {
 public:
  Cells(const std::vector<Eigen::Vector3f>& points, double half_width)
      : middle_(static_cast<int>(std::ceil(half_width / kCell)) + 2),
        values_(static_cast<size_t>(4) * middle_ * middle_) {
    for (const Eigen::Vector3f& point : points) {
      const int at = index(point.x(), point.y());
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int cell = at + step(dx, dy);
          uint8_t& value = values_[static_cast<size_t>(cell)];
          value = std::max(value, static_cast<uint8_t>(3 - std::abs(dx) - std::abs(dy)));
        }
    }
  }

  int index(double x, double y) const { return step(column(x), column(y)); }
  int step(int dx, int dy) const { return dy * 2 * middle_ + dx; }
  int value(int index) const { return values_[static_cast<size_t>(index)]; }

 private:
  int column(double x) const { return static_cast<int>(std::floor(x / kCell)) + middle_; }

  int middle_;
  std::vector<uint8_t> values_;  // [2 * middle][2 * middle]
};

}  // namespace

Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double relative_yaw,
                              double search_radius, double range) {
  constexpr double kStep = 1.5 * std::numbers::pi / 180;  // [rad]
  const Cells cells(place, range + search_radius);
  const int most = static_cast<int>(search_radius / kCell);
  int64_t best = -1;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  std::vector<int> turned;
  std::vector<std::pair<int, int>> counts;
  // From the center outwards, so that on a tie the pose nearest to the initial one wins.
  for (const int k : {0, 1, -1, 2, -2}) {
    const Eigen::AngleAxisd rotation(relative_yaw + k * kStep, Eigen::Vector3d::UnitZ());
    const Eigen::Matrix3d matrix = rotation.toRotationMatrix();
    turned.clear();
    for (const Eigen::Vector3f& point : query) {
      const Eigen::Vector3d p = matrix * point.cast<double>();
      turned.push_back(cells.index(p.x(), p.y()));
    }
    std::ranges::sort(turned);
    counts.clear();
    for (const int cell : turned) {
      if (counts.empty() || counts.back().first != cell) counts.emplace_back(cell, 0);
      ++counts.back().second;
    }
    for (int dy = -most; dy <= most; ++dy)
      for (int dx = -most; dx <= most; ++dx) {
        const int step = cells.step(dx, dy);
        int64_t sum = 0;
        for (const auto& [cell, count] : counts) sum += count * cells.value(cell + step);
        if (sum <= best) continue;
        best = sum;
        pose.linear() = matrix;
        pose.translation() = Eigen::Vector3d(dx, dy, 0) * kCell;
      }
  }
  return pose;
}

}  // namespace revisit
