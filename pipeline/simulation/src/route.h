#pragma once

#include <vector>

#include "revisit/datasets/pose.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

/// Seconds between frames: ten turns of the sensor a second.
constexpr double kFramePeriod = 0.1;

/// A drive of about `length` metres at about 8 m/s, ten poses a second. The offset in the lane
/// changes slowly, so revisits are near the first visit. Throws UsageError for another `length`.
std::vector<PlanarPose> generate_route(RouteKind kind, double length, uint64_t seed);

/// The poses of a KITTI drive seen from above: x = camera z, y = -camera x, from the first pose.
/// Height, roll and pitch are left out, because the height drifts by metres between visits.
/// Throws InputError naming `file` when the drive is not finite or too long.
std::vector<PlanarPose> flatten(const std::vector<Pose>& T_world_cam, const Pose& T_cam_velo,
                                const std::filesystem::path& file);

}  // namespace revisit::pipeline::simulation
