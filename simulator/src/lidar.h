#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "ray_caster.h"
#include "revisit/datasets/dataset.h"
#include "revisit/datasets/scan_file.h"
#include "revisit/simulation/simulation.h"

namespace revisit::simulation {

/// Scan pattern: rotating beams, or one beam: with `rosette` it covers an ellipse around forward,
/// with `nodding` all around, without repetition.
struct BeamPattern {
  std::vector<double> elevation;        // [beam], top first [rad]
  std::vector<double> azimuth_offset;   // [beam] [rad]
  int azimuths = 0;                     // firings per scan
  double field = 2 * std::numbers::pi;  // [rad], horizontal, around forward if below a full circle
  std::optional<Eigen::Vector2d> rosette;  // half width and height [rad]
  std::optional<Eigen::Vector2d> nodding;  // lowest and highest elevation [rad]
  double max_range = 0, min_range = 0;     // [m]
  bool on_car_roof = false;                // the car's roof occludes the ground behind the sensor
};
/// Throws UsageError unless it is a value of SimulationConfig::sensor.
BeamPattern beam_pattern(const std::string& sensor);

struct NoiseModel {
  double range_sigma = 0.02;  // [m]
  double dropout = 0.01;      // fraction of returns lost at random
};
void check(const NoiseModel& noise);

/// Each thread needs its own.
class Lidar {
 public:
  Lidar(const BeamPattern& pattern, const NoiseModel& noise, uint64_t seed);

  /// Simulates one revolution from `T_world_velo`: beam by beam from the top, each from forward to
  /// the left. It is instantaneous, or lasts kFramePeriod if `motion` (T_start_then) is given, and
  /// then has times.
  /// Depends only on seed, frame, poses and scene.
  PointCloud scan(int frame, const Pose& T_world_velo, RayCaster& scene,
                  const std::function<Eigen::Isometry3d(double time)>& motion = {});

 private:
  const BeamPattern& pattern_;
  NoiseModel noise_;
  uint64_t seed_;
  std::vector<Eigen::Vector3f> directions_, world_directions_;  // [beam][azimuth]
  std::vector<Eigen::Vector3f> origins_;  // world frame, [beam][azimuth] or one
  std::vector<Hit> hits_;
};

}  // namespace revisit::simulation
