#include "ground.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "random.h"

namespace revisit::simulation {
namespace {

constexpr double kKerbWidth = 0.25;     // [m]
constexpr double kPaintedPaving = 1.9;  // width in paint.cpp [m]
constexpr double kFineLimit = 9;        // [m], from the road; wider than any kerb
constexpr int kGroundTile = 8;          // [m]

}  // namespace

Ground::Ground(uint64_t seed, const RoadMap& roads, const Scenery& scenery)
    : seed_(seed),
      roads_(roads),
      scenery_(scenery),
      reach_(scenery.bank_height > 0 ? std::max(kFineLimit, scenery.kerb.high + scenery.bank.high)
                                     : kFineLimit) {
  Random random(seed, 0x67726f756e64);
  constexpr std::array<double, 6> kWavelengths = {420, 310, 170, 120, 65, 45};  // [m]
  for (size_t i = 0; i < waves_.size(); ++i) {
    const double k = 2 * std::numbers::pi / kWavelengths[i], angle = random.uniform(0, 6.283);
    // Each wave has a slope of at most 0.8 %, all together 4.8 %.
    waves_[i] = {k * Vec2(std::cos(angle), std::sin(angle)), 0.008 / k, random.uniform(0, 6.283)};
  }
}

double Ground::height(const Vec2& point) const {
  double h = 0;
  for (const Wave& w : waves_) h += w.amplitude * std::sin(w.k.dot(point) + w.phase);
  return h;
}

Eigen::Vector3d Ground::normal(const Vec2& point) const {
  Vec2 gradient = Vec2::Zero();
  for (const Wave& w : waves_) gradient += w.amplitude * std::cos(w.k.dot(point) + w.phase) * w.k;
  return Eigen::Vector3d(-gradient.x(), -gradient.y(), 1).normalized();
}

bool Ground::has_parking(const Vec2& point) const {
  return value_noise(seed_ ^ 0x7061726b, point.x(), point.y(), 55) > 0.42;
}

double Ground::kerb(const Vec2& point) const {
  const auto [narrow, wide] = scenery_.kerb;
  const double u = value_noise(seed_ ^ 0x7061726b, point.x(), point.y(), 55);
  return narrow + (wide - narrow) * std::clamp((u - 0.38) / 0.04, 0.0, 1.0);
}

double Ground::surface_height(const Vec2& point) const {
  return height(point) + relief(point, roads_.distance(point, reach_) - kerb(point));
}

double Ground::relief(const Vec2& point, double beyond) const {
  const double kerb = scenery_.kerb_height * std::clamp(beyond / kKerbWidth, 0.0, 1.0);
  if (scenery_.bank_height == 0) return kerb;
  const auto [foot, top] = scenery_.bank;
  const double up = 2 * value_noise(seed_ ^ 0x62616e6b, point.x(), point.y(), 160) - 1;
  return kerb + scenery_.bank_height * up * std::clamp((beyond - foot) / (top - foot), 0.0, 1.0);
}

void Ground::build(const std::vector<PathPoint>& path, double reach, Mesh* mesh) const {
  std::set<std::pair<int, int>> tiles;  // ordered: the mesh must not depend on a hash
  const int steps = static_cast<int>(std::ceil(reach / kGroundTile));
  Vec2 last = Vec2::Constant(1e12);
  for (const PathPoint& point : path) {
    if ((point.position - last).norm() < kGroundTile) continue;
    last = point.position;
    const int ci = static_cast<int>(std::floor(last.x() / kGroundTile));
    const int cj = static_cast<int>(std::floor(last.y() / kGroundTile));
    for (int i = -steps; i <= steps; ++i)
      for (int j = -steps; j <= steps; ++j)
        if (i * i + j * j <= steps * steps) tiles.insert({ci + i, cj + j});
  }

  const bool banks = scenery_.bank_height > 0;
  // Paint has slabs of a town's width, then lawn.
  const double no_slabs = kPaintedPaving - scenery_.paving;
  for (const auto& [ti, tj] : tiles) {
    const Vec2 corner(ti * kGroundTile, tj * kGroundTile);
    const Vec2 center = corner + Vec2::Constant(kGroundTile / 2.0);
    const double limit = kFineLimit + kGroundTile;
    const bool fine = roads_.distance(center, limit) < kFineLimit + kGroundTile * 0.7072;
    const int cells = fine ? 2 * kGroundTile : 2;  // 0.5 m, or 4 m
    const double size = static_cast<double>(kGroundTile) / cells;
    const auto first = static_cast<uint32_t>(mesh->vertices.size());
    std::vector<double> beyond;  // distance outwards from the kerb [m]
    for (int i = 0; i <= cells; ++i)
      for (int j = 0; j <= cells; ++j) {
        const Vec2 p = corner + size * Vec2(i, j);
        const double d = fine || banks ? roads_.distance(p, reach_) - kerb(p) : kFineLimit;
        const double z = height(p) + relief(p, d);
        mesh->vertices.push_back(Eigen::Vector3d(p.x(), p.y(), z).cast<float>());
        beyond.push_back(d);
        mesh->from_kerb.push_back(static_cast<float>(scenery_.asphalt ? -1
                                                     : d > 0          ? d + no_slabs
                                                                      : d));
      }
    for (int i = 0; i < cells; ++i)
      for (int j = 0; j < cells; ++j) {
        const auto a = static_cast<uint32_t>(i * (cells + 1) + j);
        const auto b = a + static_cast<uint32_t>(cells) + 1;
        const double d = beyond[a];
        const Surface s = d < 0 || scenery_.asphalt ? surface(Material::kRoad, 0.3, Look::kGround)
                          : d < scenery_.paving     ? surface(Material::kRoad, 0.36, Look::kGround)
                                                    : surface(Material::kLawn, 0.42, Look::kGround);
        mesh->add({first + a, first + b, first + b + 1}, s);
        mesh->add({first + a, first + b + 1, first + a + 1}, s);
      }
  }
}

}  // namespace revisit::simulation
