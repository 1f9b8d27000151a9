#pragma once

#include <numbers>
#include <optional>
#include <vector>

#include "ray_caster.h"
#include "revisit/datasets/motion.h"
#include "revisit/datasets/pose.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/simulation/simulation.h"

namespace revisit::pipeline::simulation {

/// Beams side by side that turn, or with `rosette` one that wanders over an ellipse around forward.
struct BeamPattern {
  std::vector<double> elevation;        // [beam], top first [rad]
  std::vector<double> azimuth_offset;   // [beam] [rad]
  int azimuths = 0;                     // firings a scan
  double field = 2 * std::numbers::pi;  // [rad] in azimuth, around forward where less than a turn
  std::optional<Eigen::Vector2d> rosette;  // half its width and height [rad]
  double max_range = 0;                    // [m]
  bool on_car_roof = false;                // the roof behind the sensor hides the ground
};
BeamPattern beam_pattern(LidarModel model);

struct NoiseModel {
  double range_sigma = 0.02;  // [m]
  double dropout = 0.01;      // share of returns lost at random
};
/// Throws UsageError for an invalid noise.
void check(const NoiseModel& noise);

/// One per thread.
class Lidar {
 public:
  Lidar(const BeamPattern& pattern, const NoiseModel& noise, uint64_t seed);

  /// One revolution from `T_world_velo`, beam by beam from the top, each from forward to the left:
  /// instantaneous, or in kFramePeriod while the sensor moves, and then with times. Depends on
  /// seed, frame, poses and scene only.
  PointCloud scan(int frame, const Pose& T_world_velo, RayCaster& scene,
                  const std::optional<SteadyMotion>& motion = {});

 private:
  const BeamPattern& pattern_;
  NoiseModel noise_;
  uint64_t seed_;
  std::vector<Eigen::Vector3f> directions_, world_directions_;  // [beam][azimuth]
  std::vector<Eigen::Vector3f> origins_;  // in the world: [beam][azimuth], or one
  std::vector<Hit> hits_;
};

}  // namespace revisit::pipeline::simulation
