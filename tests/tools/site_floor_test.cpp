#include "loops/site_floor.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "testing.h"

namespace revisit::cli {
namespace {

/// A street with a wall beside it. A fence stands free, as do those with gates; a car passed along
/// the wall.
struct Street {
  std::vector<Eigen::Vector3f> points;
  std::vector<int64_t> counts;

  Street(int64_t often, int64_t seldom) {
    const auto face = [&](double length, double height, int64_t count, const auto& place) {
      for (double a = 0; a < length; a += 0.15)
        for (double b = 0; b < height; b += 0.15) {
          points.push_back(Eigen::Vector3d(place(a, b)).cast<float>());
          counts.push_back(count);
        }
    };
    using Vector = Eigen::Vector3d;
    face(40, 20, often, [](double a, double b) { return Vector(a, b, 0); });
    face(40, 4, often, [](double a, double b) { return Vector(a, 20, b); });
    face(4, 1.3, 3 * often / 2, [](double a, double b) { return Vector(5 + a, 4, b); });
    face(4, 1.1, seldom, [](double a, double b) { return Vector(25 + a, 18, 0.3 + b); });
    face(1.8, 1.1, seldom, [](double a, double b) { return Vector(25, 18 + a, 0.3 + b); });
  }
  /// Points above the floor around a place.
  int64_t standing(double x, double y) const {
    return std::ranges::count_if(points, [&](const Eigen::Vector3f& p) {
      return p.z() > 0.25F && (p.head<2>() - Eigen::Vector2d(x, y).cast<float>()).norm() < 1.5F;
    });
  }
};

TEST(SiteFloor, ThingsSeenLessOftenThanTheFloorPassed) {
  Street street(40, 6);
  const int64_t fence = street.standing(7, 4), wall = street.standing(10, 20);
  EXPECT_GT(street.standing(27, 18), 100);
  remove_trails(street.points, street.counts);
  EXPECT_EQ(street.standing(27, 18), 0);
  EXPECT_EQ(street.standing(7, 4), fence);
  EXPECT_EQ(street.standing(10, 20), wall);
}

/// Counts of a thinned cloud tell nothing, so shapes decide: the car joins the wall.
TEST(SiteFloor, ShapesDecideInThinnedClouds) {
  Street street(1, 1);
  const int64_t car = street.standing(27, 18), wall = street.standing(10, 20);
  remove_trails(street.points, street.counts);
  EXPECT_EQ(street.standing(7, 4), 0);
  EXPECT_EQ(street.standing(27, 18), car);
  EXPECT_EQ(street.standing(10, 20), wall);
}

TEST(SiteFloor, GoesOnBeyondWhatStandsAcrossIt) {
  std::vector<Eigen::Vector3f> points;
  const auto face = [&](Eigen::Vector2f from, Eigen::Vector2f to, float z) {
    for (float x = from.x(); x < to.x(); x += 0.2F)
      for (float y = from.y(); y < to.y(); y += 0.2F) points.emplace_back(x, y, z);
  };
  face({0, 0}, {300, 10}, 0);
  for (float z = 0; z < 2; z += 0.2F) face({280, 0}, {282, 10}, z);     // a hedge
  for (float x = 60; x < 260; x += 20) face({x, 15}, {x + 15, 25}, 5);  // roofs
  const auto nodes = floor_nodes(points);
  const auto within = [&](float from, float to) {
    return std::ranges::count_if(
        nodes, [&](const auto& p) { return p.x() > from && p.x() < to && p.z() < 1; });
  };
  EXPECT_GT(within(0, 280), 100);
  EXPECT_EQ(within(279, 283), 0);
  EXPECT_GT(within(283, 300), 8);
  EXPECT_EQ(std::ranges::count_if(nodes, [](const auto& p) { return p.z() > 1; }), 0);
}

}  // namespace
}  // namespace revisit::cli
