#include "road_map.h"

#include <algorithm>
#include <cmath>

namespace revisit::simulation {
namespace {

using Vec2 = Eigen::Vector2d;

uint64_t key(int64_t i, int64_t j) {
  return static_cast<uint64_t>(i) << 32 ^ (static_cast<uint64_t>(j) & 0xffffffffu);
}
int64_t cell(double coordinate, double size) {
  return static_cast<int64_t>(std::floor(coordinate / size));
}

constexpr double kRoadCell = 4, kTakenCell = 16;  // [m]

template <class Visit>
void for_cells(const Footprint& footprint, Visit visit) {
  const double r = footprint.radius();
  for (int64_t i = cell(footprint.center.x() - r, kTakenCell);
       i <= cell(footprint.center.x() + r, kTakenCell); ++i)
    for (int64_t j = cell(footprint.center.y() - r, kTakenCell);
         j <= cell(footprint.center.y() + r, kTakenCell); ++j)
      visit(key(i, j));
}

}  // namespace

double Footprint::distance(const Vec2& point) const {
  const Vec2 d = point - center;
  const double u = std::abs(d.dot(axis)) - half.x();
  const double v = std::abs(axis.x() * d.y() - axis.y() * d.x()) - half.y();
  return std::hypot(std::max(u, 0.0), std::max(v, 0.0));
}

bool Footprint::overlaps(const Footprint& other) const {
  // Separating axis theorem: rectangles are disjoint if a side of one separates them.
  const Vec2 d = other.center - center;
  const auto separated = [&](const Vec2& n) {
    const auto reach = [&](const Footprint& f) {
      return f.half.x() * std::abs(f.axis.dot(n)) +
             f.half.y() * std::abs(f.axis.x() * n.y() - f.axis.y() * n.x());
    };
    return std::abs(d.dot(n)) >= reach(*this) + reach(other);
  };
  const auto normal = [](const Vec2& v) { return Vec2(-v.y(), v.x()); };
  return !(separated(axis) || separated(normal(axis)) || separated(other.axis) ||
           separated(normal(other.axis)));
}

Path resample(const std::vector<PlanarPose>& poses) {
  Path result;
  std::vector<PathPoint>& path = result.points;
  size_t piece = 0;  // index of the first point of the current piece
  const auto finish_piece = [&] {
    // Directions are averaged over 2 m each way, because poses jitter by centimeters.
    const size_t end = path.size();
    for (size_t i = piece; i < end; ++i) {
      const size_t a = std::max(piece + 4, i) - 4, b = std::min(i + 4, end - 1);
      const Vec2 d = path[b].position - path[a].position;
      if (d.norm() > 0.1) path[i].forward = d.normalized();
    }
    piece = end;
  };
  for (const PlanarPose& pose : poses) {
    const Vec2 p(pose.x, pose.y), heading(std::cos(pose.yaw), std::sin(pose.yaw));
    if (path.size() > piece && (p - path.back().position).norm() > kMaxGap) finish_piece();
    if (path.size() == piece) path.push_back({p, heading});
    const Vec2 from = path.back().position;
    const double length = (p - from).norm();
    for (double s = kPathStep; s <= length; s += kPathStep)
      path.push_back({from + (p - from) * (s / length), heading});
    result.point_of_pose.push_back(path.size() - 1);
  }
  finish_piece();
  return result;
}

RoadMap::RoadMap(const std::vector<PlanarPose>& poses, const std::vector<PathPoint>& path,
                 double oncoming) {
  for (const PlanarPose& pose : poses) add({pose.x, pose.y}, 0);
  for (const PathPoint& point : path) {
    add(point.position, 0);
    add(point.position + oncoming * point.left(), 1);
  }
}

void RoadMap::add(const Vec2& position, double extra) {
  auto& points = cells_[key(cell(position.x(), kRoadCell), cell(position.y(), kRoadCell))];
  // Merges passes of one road: points within 5 cm add nothing.
  for (const RoadPoint& known : points)
    if (known.extra <= extra && (known.position - position).squaredNorm() < 0.05 * 0.05) return;
  points.push_back({position, extra});
}

template <class Visit>
void RoadMap::near(const Vec2& point, double radius, Visit visit) const {
  for (int64_t i = cell(point.x() - radius, kRoadCell); i <= cell(point.x() + radius, kRoadCell);
       ++i)
    for (int64_t j = cell(point.y() - radius, kRoadCell); j <= cell(point.y() + radius, kRoadCell);
         ++j)
      if (const auto found = cells_.find(key(i, j)); found != cells_.end())
        for (const RoadPoint& p : found->second)
          if (!visit(p)) return;
}

double RoadMap::distance(const Vec2& point, double limit) const {
  double best = limit;
  near(point, limit, [&](const RoadPoint& p) {
    best = std::min(best, (p.position - point).norm() + p.extra);
    return true;
  });
  return best;
}

bool RoadMap::clear(const Footprint& footprint, double clearance) const {
  bool is_clear = true;
  near(footprint.center, footprint.radius() + clearance, [&](const RoadPoint& p) {
    return is_clear = footprint.distance(p.position) + p.extra >= clearance;
  });
  return is_clear;
}

bool Occupancy::free(const Footprint& footprint) const {
  bool is_free = true;
  for_cells(footprint, [&](uint64_t k) {
    if (const auto found = cells_.find(k); found != cells_.end())
      for (const Footprint& taken : found->second) is_free = is_free && !taken.overlaps(footprint);
  });
  return is_free;
}

bool Occupancy::free(const Vec2& point) const {
  const auto found = cells_.find(key(cell(point.x(), kTakenCell), cell(point.y(), kTakenCell)));
  if (found == cells_.end()) return true;
  return std::none_of(found->second.begin(), found->second.end(),
                      [&](const Footprint& taken) { return taken.distance(point) == 0; });
}

void Occupancy::take(const Footprint& footprint) {
  for_cells(footprint, [&](uint64_t k) { cells_[k].push_back(footprint); });
}

}  // namespace revisit::simulation
