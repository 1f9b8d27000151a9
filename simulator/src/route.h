#pragma once

#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/simulation/simulation.h"
#include "road_map.h"

namespace revisit::simulation {

constexpr double kFramePeriod = 0.1;  // [s]

/// Drives about `length` meters at about 8 m/s, ten poses per second. The offset in the lane
/// changes slowly, so revisits are near the first visit. Throws UsageError if `length` is out of
/// range.
std::vector<PlanarPose> generate_route(RouteKind kind, double length, uint64_t seed);

/// Projects a KITTI drive to the plane: x = camera z, y = -camera x, from the first pose. Height,
/// roll and pitch are dropped, because the height drifts by meters between visits. Throws
/// InputError with `file` if a pose is not finite or the drive is too long.
std::vector<PlanarPose> flatten(const std::vector<Pose>& T_world_cam, const Pose& T_cam_velo,
                                const std::filesystem::path& file);

}  // namespace revisit::simulation
