#pragma once

#include <Eigen/Core>
#include <vector>

namespace revisit::cli {

/// Points of a site that a robot can stand on, 4 m apart: low points around, and nothing above them
/// up to its height. Parts that are small beside the largest, as roofs are, do not count.
std::vector<Eigen::Vector3f> floor_nodes(const std::vector<Eigen::Vector3f>& points);

/// Removes trails of things that passed while a site was recorded. The scanner saw the floor below
/// them before or after, but never below parked cars, walls or hedges. A trail is broad and at
/// least 15 m long, so that fences do not count, or a part of 1.2 to 6 m with floor all around.
void remove_trails(std::vector<Eigen::Vector3f>& points);

}  // namespace revisit::cli
