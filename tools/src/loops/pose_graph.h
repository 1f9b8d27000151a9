#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

namespace revisit::cli {

struct PoseEdge {
  size_t from = 0, to = 0;
  Eigen::Isometry3d T_from_to;
  Eigen::Matrix<double, 6, 6> information;  // as Registration::information
  bool is_loop = false;                     // may be incorrect: gets a robust kernel
};

/// Of a step of odometry, which is not given: a random walk of 1.7 cm and 0.05 degrees per square
/// root of a meter, so that the variance grows with the length of the step (at least 0.1 m).
Eigen::Matrix<double, 6, 6> odometry_information(const Eigen::Isometry3d& step);

/// Moves T_world_node to the least squares of the edges, by Levenberg and Marquardt. Loops have
/// Huber's kernel, which closes large drift, then Cauchy's, which rejects incorrect ones. In each
/// connected part the first node stays.
void optimize(const std::vector<PoseEdge>& edges, std::vector<Eigen::Isometry3d>& poses);

}  // namespace revisit::cli
