#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace revisit::pipeline::simulation {

/// [m], [rad], x-axis forward.
struct PlanarPose {
  double x = 0, y = 0, yaw = 0;
};

/// One point of the driven path, every kPathStep metres.
struct PathPoint {
  Eigen::Vector2d position;  // [m]
  Eigen::Vector2d forward;   // unit
  Eigen::Vector2d left() const { return {-forward.y(), forward.x()}; }
};

/// Nothing but the ground stands nearer than this to any pose of the vehicle [m].
constexpr double kRoadHalfWidth = 3.0;
/// Distance between neighbouring path points [m].
constexpr double kPathStep = 0.5;
/// The lane of oncoming cars in a town, to the left of the driven path [m].
constexpr double kOncomingOffset = 3.2;

/// An oriented rectangle on the ground.
struct Footprint {
  Eigen::Vector2d center;
  Eigen::Vector2d axis;  // unit, direction of half.x()
  Eigen::Vector2d half;  // half sizes [m]
  double radius() const { return half.norm(); }
  double distance(const Eigen::Vector2d& point) const;  // 0 inside
  bool overlaps(const Footprint& other) const;
};

/// The driven path, resampled by distance (a vehicle at rest adds nothing). Poses further apart
/// than kLargestGap are not joined: the path has several pieces, one after the other.
struct Path {
  std::vector<PathPoint> points;
  std::vector<size_t> point_of_pose;  // [pose], the path point it is at
};
Path resample(const std::vector<PlanarPose>& poses);
constexpr double kLargestGap = 40;  // [m]

/// The road is the driven path and the lane for oncoming traffic.
class RoadMap {
 public:
  /// The oncoming lane is `oncoming` metres to the left of the path.
  RoadMap(const std::vector<PlanarPose>& poses, const std::vector<PathPoint>& path,
          double oncoming);

  /// Distance [m] to the driven lane's centre, at most `limit`. The oncoming lane counts 1 m more,
  /// because nothing is measured from there.
  double distance(const Eigen::Vector2d& point, double limit) const;
  /// True when the road is at least `clearance` away from the whole rectangle.
  bool clear(const Footprint& footprint, double clearance) const;

 private:
  struct RoadPoint {
    Eigen::Vector2d position;
    double extra;  // added to the distance [m]
  };
  void add(const Eigen::Vector2d& position, double extra);
  template <class Visit>
  void near(const Eigen::Vector2d& point, double radius, Visit visit) const;

  std::unordered_map<uint64_t, std::vector<RoadPoint>> cells_;
};

/// Ground that is taken: rectangles that may not overlap.
class Occupancy {
 public:
  bool free(const Footprint& footprint) const;
  bool free(const Eigen::Vector2d& point) const;
  void take(const Footprint& footprint);

 private:
  std::unordered_map<uint64_t, std::vector<Footprint>> cells_;
};

}  // namespace revisit::pipeline::simulation
