#pragma once

#include <Eigen/Core>
#include <vector>

namespace revisit::pipeline {

/// What a pair of points says of the pose.
struct Residual {
  Eigen::Matrix<double, 6, 1> jacobian;  // of translation [1] and rotation [m]
  double distance = 0;                   // of the query's point from the place's plane [m]
  Eigen::Vector3d at;                    // in the place's frame [m]
};

/// Registration::information of at least one pair. `hessian` is the sum of J J^T.
Eigen::Matrix<double, 6, 6> information_of(const std::vector<Residual>& residuals,
                                           const Eigen::Matrix<double, 6, 6>& hessian);

}  // namespace revisit::pipeline
