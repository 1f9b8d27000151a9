#pragma once

#include <vector>

#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::pipeline::simulation {

/// Seconds between frames: ten turns of the sensor a second.
constexpr double kFramePeriod = 0.1;

/// A drive through generated streets: about `length` metres at about 8 m/s, ten poses a second.
/// Revisits keep to their lane with a slowly changing offset, so they are near the first visit
/// but not on it. Throws UsageError when `length` is too short for the kind of route.
std::vector<PlanarPose> generate_route(RouteKind kind, double length, uint64_t seed);

/// The poses of a KITTI drive seen from above, in a frame with x = camera z (forward of frame 0),
/// y = -camera x (left), around the first pose. Height, roll and pitch are left out: the
/// ground truth's height drifts by metres between visits of the same place.
/// Throws InputError naming `file` when the drive cannot be a road (not finite, too long).
std::vector<PlanarPose> flatten(const std::vector<Pose>& T_world_cam, const Pose& T_cam_velo,
                                const std::filesystem::path& file);

}  // namespace revisit::pipeline::simulation
