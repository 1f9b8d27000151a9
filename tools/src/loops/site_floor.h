#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace revisit::cli {

/// Points of a site that a robot can stand on, 4 m apart: low points around, and nothing above them
/// up to its height. Parts that are small beside the largest, as roofs are, do not count.
std::vector<Eigen::Vector3f> floor_nodes(const std::vector<Eigen::Vector3f>& points);

/// Removes trails of things that passed while a site was recorded. The scanner saw the floor below
/// them before or after, but never below parked cars or walls. `counts` are the numbers of recorded
/// points that each point stands for. Of a trail they are lower than of the floor below it, because
/// it was there for some scans only. Where they tell nothing, as in a thinned cloud, a trail is
/// broad and at least 15 m long, so that fences do not count, or a part of 1.2 to 6 m with floor
/// all around.
void remove_trails(std::vector<Eigen::Vector3f>& points, const std::vector<int64_t>& counts);

}  // namespace revisit::cli
