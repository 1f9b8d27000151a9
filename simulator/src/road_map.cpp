#include "road_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "random.h"
#include "revisit/base/error.h"

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

using Polyline = std::vector<Vec2>;

constexpr double kCornerRadius = 9;  // [m]
constexpr double kLaneOffset =
    -1.2;                        // left of the street's middle; negative: drives on the right [m]
constexpr double kWander = 0.5;  // maximum change of the lane offset [m]
constexpr double kSpeed = 8.0;   // [m/s]
constexpr double kShortestRoute = 300, kMaxRoute = 30000;  // [m]

Vec2 unit(double angle) {
  return {std::cos(angle), std::sin(angle)};
}

/// Closed hexagon with a notch, about `circumference` meters around, with the first point repeated.
Polyline block(Random& random, const Vec2& start, double heading, double circumference) {
  const double a = random.uniform(0.26, 0.32), b = random.uniform(0.18, 0.22);
  const double notch = random.uniform(0.3, 0.6);
  const Vec2 u = unit(heading), v = unit(heading + std::numbers::pi / 2);
  const double skew = random.uniform(-0.15, 0.15);
  Polyline corners = {Vec2(0, 0),
                      Vec2(a, 0),
                      Vec2(a + skew * b, b * notch),
                      Vec2(a * 0.55, b * notch * random.uniform(0.85, 1.15)),
                      Vec2(a * 0.5 + skew * b, b),
                      Vec2(skew * b * 0.5, b * random.uniform(0.9, 1.1)),
                      Vec2(0, 0)};
  double around = 0;
  for (size_t i = 1; i < corners.size(); ++i) around += (corners[i] - corners[i - 1]).norm();
  const double scale = circumference / around;
  for (Vec2& c : corners) c = start + scale * (c.x() * u + c.y() * v);
  return corners;
}

/// Bends every 60 to 120 m; writes its final heading to `heading`.
Polyline street(Random& random, double length, double* heading) {
  Polyline points = {Vec2(0, 0)};
  double side = random.chance(0.5) ? 1 : -1;
  while (length > 0) {
    const double piece = length < 150 ? length : random.uniform(60, 120);
    points.push_back(points.back() + piece * unit(*heading));
    length -= piece;
    if (length > 0) *heading += side * random.uniform(0.3, 0.8);
    side = -side;
  }
  return points;
}

void extend(Polyline* route, const Polyline& next) {
  const bool joined = !route->empty() && (route->back() - next.front()).norm() < 1e-6;
  route->insert(route->end(), next.begin() + (joined ? 1 : 0), next.end());
}

void trim(Polyline* route, double length) {
  for (size_t i = 1; i < route->size(); ++i) {
    const Vec2 step = (*route)[i] - (*route)[i - 1];
    if (step.norm() >= length) {
      (*route)[i] = (*route)[i - 1] + step * (length / step.norm());
      route->resize(i + 1);
      return;
    }
    length -= step.norm();
  }
}

/// Samples the polyline with rounded corners every 0.1 m.
Polyline rounded(const Polyline& corners) {
  Polyline points;
  const auto line_to = [&](const Vec2& to) {
    const Vec2 from = points.back();
    const int n = std::max(1, static_cast<int>((to - from).norm() / 0.1));
    for (int i = 1; i <= n; ++i)
      points.push_back(from + (to - from) * (static_cast<double>(i) / n));
  };
  points.push_back(corners.front());
  for (size_t i = 1; i + 1 < corners.size(); ++i) {
    const Vec2 in = (corners[i] - corners[i - 1]).normalized();
    const Vec2 out = (corners[i + 1] - corners[i]).normalized();
    const double turn = std::atan2(in.x() * out.y() - in.y() * out.x(), in.dot(out));
    if (std::abs(turn) < 1e-3) continue;
    const double half = std::tan(std::abs(turn) / 2);
    const double shortest =
        std::min((corners[i] - corners[i - 1]).norm(), (corners[i + 1] - corners[i]).norm());
    const double radius = std::min(kCornerRadius, 0.45 * shortest / half);
    const double side = turn > 0 ? 1 : -1;
    line_to(corners[i] - in * radius * half);
    const Vec2 center = points.back() + side * radius * Vec2(-in.y(), in.x());
    const Vec2 spoke = points.back() - center;
    const int n = std::max(2, static_cast<int>(radius * std::abs(turn) / 0.1));
    for (int k = 1; k <= n; ++k) {
      const Eigen::Rotation2Dd rotation(turn * k / n);
      points.push_back(center + rotation * spoke);
    }
  }
  line_to(corners.back());
  return points;
}

std::vector<PlanarPose> drive(const Polyline& middle, uint64_t seed) {
  // The lane is the center line with a lateral offset that depends on the distance driven, so that
  // it differs between passes. Directions are averaged over 1 m each way.
  const size_t n = middle.size();
  std::vector<Vec2> lane(n);
  const auto direction = [n](const auto& line, size_t i) {
    return Vec2((line[std::min(i + 10, n - 1)] - line[i < 10 ? 0 : i - 10]).normalized());
  };
  for (size_t i = 0; i < n; ++i) {
    const double s = 0.1 * static_cast<double>(i);
    const double offset =
        kLaneOffset + kWander * (2 * value_noise(seed ^ 0x6c616e65, s, 0, 45) - 1);
    const Vec2 d = direction(middle, i);
    lane[i] = middle[i] + offset * Vec2(-d.y(), d.x());
  }
  std::vector<PlanarPose> poses;
  for (double s = 0; s < 0.1 * static_cast<double>(n - 1);) {
    const auto i = static_cast<size_t>(s / 0.1);
    const Vec2 d = direction(lane, i);
    poses.push_back({lane[i].x(), lane[i].y(), std::atan2(d.y(), d.x())});
    const Vec2 ahead = direction(lane, std::min(i + 80, n - 1)),
               behind = direction(lane, i < 80 ? 0 : i - 80);
    const double turn = std::acos(std::clamp(ahead.dot(behind), -1.0, 1.0));
    const double mood = 0.9 + 0.25 * value_noise(seed ^ 0x73706565, s, 0, 90);
    s += kSpeed * mood / (1 + 0.7 * turn) * kFramePeriod;
  }
  return poses;
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

std::vector<PlanarPose> generate_route(const std::string& kind, double length, uint64_t seed) {
  if (!(length >= kShortestRoute && length <= kMaxRoute))
    throw UsageError("route length: expected ", kShortestRoute, " to ", kMaxRoute, " m, found ",
                     length, " m");
  if (kind != "loop" && kind != "opposite" && kind != "both")
    throw UsageError("route: expected loop, opposite or both, found '", kind, "'");
  Random random(seed, 0x726f757465);
  Polyline route;
  double heading = random.uniform(0, 2 * std::numbers::pi);
  if (kind == "loop") {
    const Polyline around = block(random, Vec2(0, 0), heading, length / 1.6);
    extend(&route, around);
    extend(&route, around);
  } else {
    const double stem_share = kind == "opposite" ? 0.36 : 0.24;
    const double rounds = kind == "opposite" ? 1 : 2;
    const Polyline stem = street(random, stem_share * length, &heading);
    const Polyline around = block(random, stem.back(), heading + random.uniform(-0.2, 0.2),
                                  (1 - 2 * stem_share) * length / rounds);
    extend(&route, stem);
    for (int i = 0; i < static_cast<int>(rounds); ++i) extend(&route, around);
    extend(&route, Polyline(stem.rbegin(), stem.rend()));
  }
  trim(&route, length);
  return drive(rounded(route), seed);
}

std::vector<PlanarPose> flatten(const std::vector<Pose>& T_world_cam, const Pose& T_cam_velo,
                                const std::filesystem::path& file) {
  std::vector<PlanarPose> poses;
  double length = 0;
  for (size_t i = 0; i < T_world_cam.size(); ++i) {
    const Pose T_world_velo = T_world_cam[i] * T_cam_velo;
    const Eigen::Vector3d p = T_world_velo.translation(), forward = T_world_velo.linear().col(0);
    const std::string where = str(file.string(), ":", i + 1, ": ");
    if (!p.allFinite() || !forward.allFinite()) throw InputError(where + "pose is not finite");
    PlanarPose pose{p.z(), -p.x(), std::atan2(-forward.x(), forward.z())};
    if (!poses.empty()) {
      pose.x -= poses.front().x;
      pose.y -= poses.front().y;
      const Vec2 from = i == 1 ? Vec2(0, 0) : Vec2(poses.back().x, poses.back().y);
      const double step = (Vec2(pose.x, pose.y) - from).norm();
      if (step <= kMaxGap) length += step;
      if (std::hypot(pose.x, pose.y) > kMaxRoute || length > kMaxRoute)
        throw InputError(where, "the drive is longer than ", kMaxRoute / 1000,
                         " km; a town along it would not fit in memory: simulate a part of it");
    }
    poses.push_back(pose);
  }
  if (poses.empty()) throw InputError(file.string() + ": no poses");
  poses.front().x = poses.front().y = 0;
  return poses;
}

}  // namespace revisit::simulation
