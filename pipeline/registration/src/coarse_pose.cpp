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
          float& value = values_[static_cast<size_t>(cell)];
          value = std::max(value, static_cast<float>(3 - std::abs(dx) - std::abs(dy)));
        }
    }
  }

  int index(double x, double y) const { return step(column(x), column(y)); }
  int step(int dx, int dy) const { return dy * 2 * middle_ + dx; }
  /// The cells at and after `index`.
  const float* at(int index) const { return &values_[static_cast<size_t>(index)]; }

 private:
  int column(double x) const { return static_cast<int>(std::floor(x / kCell)) + middle_; }

  int middle_;
  std::vector<float> values_;  // [2 * middle][2 * middle]
};

}  // namespace

Eigen::Isometry3d coarse_pose(const std::vector<Eigen::Vector3f>& query,
                              const std::vector<Eigen::Vector3f>& place, double relative_yaw,
                              double search_radius, double range) {
  constexpr double kStep = 1.5 * std::numbers::pi / 180;  // [rad]
  const Cells cells(place, range + search_radius);
  const int most = static_cast<int>(search_radius / kCell);
  // Of each shift the sum over the query, exact: [dx][dy], both from -most.
  Eigen::ArrayXXf sums(2 * most + 1, 2 * most + 1);
  float best = -1;
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
    sums.setZero();
    for (const auto& [cell, count] : counts)
      for (int dy = -most; dy <= most; ++dy)
        sums.col(dy + most) +=
            static_cast<float>(count) *
            Eigen::Map<const Eigen::ArrayXf>(cells.at(cell + cells.step(-most, dy)), sums.rows());
    for (int dy = -most; dy <= most; ++dy)
      for (int dx = -most; dx <= most; ++dx) {
        const float sum = sums(dx + most, dy + most);
        if (sum <= best) continue;
        best = sum;
        pose.linear() = matrix;
        pose.translation() = Eigen::Vector3d(dx, dy, 0) * kCell;
      }
  }
  return pose;
}

}  // namespace revisit
