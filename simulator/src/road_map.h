#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/simulation/simulation.h"

namespace revisit::simulation {

/// [m], [rad], x-axis forward.
struct PlanarPose {
  double x = 0, y = 0, yaw = 0;
};

struct PathPoint {
  Eigen::Vector2d position;  // [m]
  Eigen::Vector2d forward;   // unit
  Eigen::Vector2d left() const { return {-forward.y(), forward.x()}; }
};

constexpr double kRoadHalfWidth = 3.0;   // [m] minimum distance of objects to any pose
constexpr double kPathStep = 0.5;        // [m] between adjacent path points
constexpr double kOncomingOffset = 3.2;  // [m] to the left of the driven path, in a town

struct Footprint {
  Eigen::Vector2d center;
  Eigen::Vector2d axis;  // unit, direction of half.x()
  Eigen::Vector2d half;  // half sizes [m]
  double radius() const { return half.norm(); }
  double distance(const Eigen::Vector2d& point) const;  // 0 inside
  bool overlaps(const Footprint& other) const;
};

/// Resampled by distance (standing adds nothing); split where poses are farther apart than kMaxGap.
struct Path {
  std::vector<PathPoint> points;
  std::vector<size_t> point_of_pose;  // [pose]
};
Path resample(const std::vector<PlanarPose>& poses);
constexpr double kMaxGap = 40;  // [m]

class RoadMap {
 public:
  /// The oncoming lane is `oncoming` meters to the left of the path.
  RoadMap(const std::vector<PlanarPose>& poses, const std::vector<PathPoint>& path,
          double oncoming);

  /// Returns the distance [m] to the driven lane's center, at most `limit`. The oncoming lane
  /// counts 1 m more, because no scan is taken there.
  double distance(const Eigen::Vector2d& point, double limit) const;
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

class Occupancy {
 public:
  bool free(const Footprint& footprint) const;
  bool free(const Eigen::Vector2d& point) const;
  void take(const Footprint& footprint);

 private:
  std::unordered_map<uint64_t, std::vector<Footprint>> cells_;
};

constexpr double kFramePeriod = 0.1;  // [s]

/// Drives about `length` meters at about 8 m/s, ten poses per second. The offset in the lane
/// changes slowly, so revisits are near the first visit. Throws UsageError if `length` is out of
/// range or `kind` is no value of SimulationConfig::route.
std::vector<PlanarPose> generate_route(const std::string& kind, double length, uint64_t seed);

/// Projects a KITTI drive to the plane: x = camera z, y = -camera x, from the first pose. Height,
/// roll and pitch are dropped, because the height drifts by meters between visits. Throws
/// InputError with `file` if a pose is not finite or the drive is too long.
std::vector<PlanarPose> flatten(const std::vector<Pose>& T_world_cam, const Pose& T_cam_velo,
                                const std::filesystem::path& file);

}  // namespace revisit::simulation
