#include "loops/site_floor.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <unordered_map>
#include <utility>

namespace revisit::cli {
namespace {

using Cell = std::pair<int, int>;

Cell cell_of(const Eigen::Vector3f& point, float edge) {
  return {static_cast<int>(std::floor(point.x() / edge)),
          static_cast<int>(std::floor(point.y() / edge))};
}

template <class Take>
void around(const Cell& cell, int reach, const Take& take) {
  for (int x = -reach; x <= reach; ++x)
    for (int y = -reach; y <= reach; ++y) take(Cell(cell.first + x, cell.second + y));
}

struct CellHash {
  size_t operator()(const Cell& cell) const {
    return static_cast<size_t>(cell.first) * 0x9E3779B97F4A7C15U ^
           static_cast<size_t>(cell.second) * 0xC2B2AE3D27D4EB4FU;
  }
};

/// Connected cells.
struct Part {
  int64_t size = 0;
  Cell low, high;  // corners

  void add(const Cell& cell) {
    if (size++ == 0) low = high = cell;
    low = {std::min(low.first, cell.first), std::min(low.second, cell.second)};
    high = {std::max(high.first, cell.first), std::max(high.second, cell.second)};
  }
  /// The longer side, of cells with the given edge.
  double length(double edge) const {
    return edge * (1 + std::max(high.first - low.first, high.second - low.second));
  }
};

/// Sets the number of the part of each cell, which is -1 before.
std::vector<Part> parts_of(std::map<Cell, int>& cells) {
  std::vector<Part> parts;
  for (auto& [cell, part] : cells) {
    if (part >= 0) continue;
    const int name = part = static_cast<int>(std::ssize(parts));
    parts.emplace_back();
    for (std::vector<Cell> open{cell}; !open.empty();) {
      const Cell at = open.back();
      open.pop_back();
      parts.back().add(at);
      around(at, 1, [&](const Cell& near) {
        const auto found = cells.find(near);
        if (found == cells.end() || found->second >= 0) return;
        found->second = name;
        open.push_back(near);
      });
    }
  }
  return parts;
}

/// Columns of space, and where something is above a floor that was seen.
class Columns {
 public:
  static constexpr float kEdge = 0.3F;  // [m]

  Columns(const std::vector<Eigen::Vector3f>& points, const std::vector<int64_t>& counts) {
    for (const Eigen::Vector3f& p : points) {
      float& floor = floors_.try_emplace(block_of(p), p.z()).first->second;
      floor = std::min(floor, p.z());
    }
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3f& p = points[i];
      Column& column = columns_[cell_of(p, kEdge)];
      if (p.z() - floors_.at(block_of(p)) < kFloor) column.floor.add(counts[i]);
      if (is_above_floor(p)) column.above.add(counts[i]);
    }
  }

  /// Above the floor and not higher than vehicles.
  bool is_above_floor(const Eigen::Vector3f& point) const {
    constexpr float kLow = 0.25F, kHigh = 3;  // [m]
    const float height = point.z() - floors_.at(block_of(point));
    return height > kLow && height < kHigh;
  }

  /// Cells of trails; see remove_trails(). Chosen on a town, in which moving things have ratios of
  /// 0.04 to 1.4 (5 to 95 % of the voxels), others of 0.9 to 3.4. A thinned cloud has some 1.
  std::map<Cell, int> trails() const {
    constexpr double kSeldom = 0.7, kOften = 1.2;
    std::map<Cell, int> found = trails_by_shape();
    for (const auto& [cell, column] : columns_) {
      if (!column.has_floor() || !column.is_below()) continue;
      const double seen = seen_by_floor(cell);
      if (seen < kSeldom) found[cell] = 0;
      if (seen > kOften) found.erase(cell);
    }
    return found;
  }

 private:
  static constexpr float kFloor = 0.2F;  // thickness [m]

  struct Points {
    int64_t voxels = 0, count = 0;

    void add(int64_t points) {
      ++voxels;
      count += points;
    }
    void add(const Points& others) {
      voxels += others.voxels;
      count += others.count;
    }
    double mean() const { return static_cast<double>(count) / static_cast<double>(voxels); }
  };

  struct Column {
    Points floor, above;
    bool has_floor() const { return floor.voxels > 0; }
    bool is_below() const { return above.voxels > 0; }  // something
  };

  static Cell block_of(const Eigen::Vector3f& point) { return cell_of(point, 3 * kEdge); }

  /// How often what is above the floor was seen around a cell that has both. The floor: 1.
  double seen_by_floor(const Cell& cell) const {
    Points floor, above;
    around(cell, 2, [&](const Cell& near) {
      const auto found = columns_.find(near);
      if (found == columns_.end()) return;
      floor.add(found->second.floor);
      above.add(found->second.above);
    });
    return above.mean() / floor.mean();
  }

  std::map<Cell, int> trails_by_shape() const {
    constexpr double kLength = 15, kLongest = 6, kShortest = 1.2;  // [m]
    std::map<Cell, int> found = covered(), islands = columns_below();
    const std::vector<Part> wide = parts_of(found), parts = parts_of(islands);
    std::erase_if(found, [&](const auto& cell) {
      return wide[static_cast<size_t>(cell.second)].length(kEdge) < kLength;
    });
    std::vector<bool> stands(parts.size(), false);  // on something that hides the floor
    for (const auto& [cell, part] : islands)
      if (!stands[static_cast<size_t>(part)])
        around(cell, 2, [&](const Cell& near) {
          if (!has_floor(near)) stands[static_cast<size_t>(part)] = true;
        });
    for (const auto& [cell, part] : islands) {
      const double length = parts[static_cast<size_t>(part)].length(kEdge);
      if (!stands[static_cast<size_t>(part)] && length >= kShortest && length <= kLongest)
        found[cell] = part;
    }
    return found;
  }

  bool has_floor(const Cell& cell) const {
    const auto found = columns_.find(cell);
    return found != columns_.end() && found->second.has_floor();
  }

  std::map<Cell, int> columns_below() const {
    std::map<Cell, int> cells;
    for (const auto& [cell, column] : columns_)
      if (column.is_below()) cells[cell] = -1;
    return cells;
  }

  /// Squares with a floor throughout and something above more than half of it.
  std::map<Cell, int> covered() const {
    constexpr int kReach = 2, kAll = (2 * kReach + 1) * (2 * kReach + 1);
    std::map<Cell, int> cells;
    for (const auto& [cell, column] : columns_) {
      if (!column.has_floor()) continue;
      int floor = 0, below = 0;
      around(cell, kReach, [&](const Cell& near) {
        const auto found = columns_.find(near);
        if (found == columns_.end() || !found->second.has_floor()) return;
        ++floor;
        below += found->second.is_below() ? 1 : 0;
      });
      if (floor == kAll && 2 * below > kAll)
        around(cell, kReach, [&](const Cell& near) { cells[near] = -1; });
    }
    return cells;
  }

  std::unordered_map<Cell, float, CellHash> floors_;  // lowest points
  std::unordered_map<Cell, Column, CellHash> columns_;
};

/// Free floor by cells of 1 m.
class Floor {
 public:
  explicit Floor(const std::vector<Eigen::Vector3f>& points) {
    for (const Eigen::Vector3f& p : points) {
      float& lowest = lowest_.try_emplace(cell_of(p, 1), p.z()).first->second;
      lowest = std::min(lowest, p.z());
    }
    for (const Eigen::Vector3f& p : points) {
      constexpr float kStep = 0.4F, kHeadroom = 2.2F;  // [m]
      const Cell cell = cell_of(p, 1);
      const float above = p.z() - lowest_.at(cell);
      if (above > kStep && above < kHeadroom) blocked_[cell] = true;
    }
    for (const auto& [cell, z] : lowest_)
      if (is_free(cell)) free_[cell] = -1;
  }

  /// Cells near the nodes of a grid.
  std::vector<Eigen::Vector3f> nodes() {
    constexpr float kGrid = 4;  // [m]
    const std::vector<int64_t> sizes = joined_sizes();
    const int64_t largest = sizes.empty() ? 0 : std::ranges::max(sizes);
    std::map<Cell, Eigen::Vector3f> chosen;
    for (const auto& [cell, part] : free_) {
      if (10 * sizes[static_cast<size_t>(part)] < largest) continue;
      const Eigen::Vector3f center(static_cast<float>(cell.first) + 0.5F,
                                   static_cast<float>(cell.second) + 0.5F, lowest_.at(cell));
      chosen.try_emplace(cell_of(center, kGrid), center);
    }
    std::vector<Eigen::Vector3f> points;
    for (const auto& [node, point] : chosen) points.push_back(point);
    return points;
  }

 private:
  /// Of each part: the size of the largest one that it continues beyond a hedge or what is left of
  /// traffic. Roofs continue roofs at most.
  std::vector<int64_t> joined_sizes() {
    constexpr int kGap = 8;          // [m]
    constexpr float kHeight = 0.5F;  // [m]
    std::vector<int64_t> sizes;
    for (const Part& part : parts_of(free_)) sizes.push_back(part.size);
    std::set<std::pair<size_t, size_t>> joined;
    for (const auto& [cell, part] : free_) {
      bool is_edge = false;  // others have no neighbor part, and are most
      around(cell, 1, [&](const Cell& near) { is_edge = is_edge || !free_.contains(near); });
      if (!is_edge) continue;
      around(cell, kGap, [&](const Cell& near) {
        const auto other = free_.find(near);
        if (other != free_.end() && other->second != part &&
            std::abs(lowest_.at(near) - lowest_.at(cell)) < kHeight)
          joined.emplace(part, other->second);
      });
    }
    for (bool grow = true; std::exchange(grow, false);)
      for (const auto& [part, other] : joined)
        if (sizes[part] < sizes[other]) {
          sizes[part] = sizes[other];
          grow = true;
        }
    return sizes;
  }

  bool is_free(const Cell& cell) const {
    constexpr float kSlope = 0.3F;  // between cells [m]
    bool free = true;
    around(cell, 1, [&](const Cell& near) {
      const auto found = lowest_.find(near);
      free = free && found != lowest_.end() && !blocked_.contains(near) &&
             std::abs(found->second - lowest_.at(cell)) < kSlope;
    });
    return free;
  }

  std::map<Cell, float> lowest_;
  std::map<Cell, bool> blocked_;
  std::map<Cell, int> free_;  // -> part
};

}  // namespace

std::vector<Eigen::Vector3f> floor_nodes(const std::vector<Eigen::Vector3f>& points) {
  return Floor(points).nodes();
}

void remove_trails(std::vector<Eigen::Vector3f>& points, const std::vector<int64_t>& counts) {
  const Columns columns(points, counts);
  const std::map<Cell, int> trails = columns.trails();
  std::erase_if(points, [&](const Eigen::Vector3f& p) {
    return columns.is_above_floor(p) && trails.contains(cell_of(p, Columns::kEdge));
  });
}

}  // namespace revisit::cli
