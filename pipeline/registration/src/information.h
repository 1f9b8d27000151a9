#pragma once

#include <Eigen/Core>
#include <vector>

namespace revisit {

struct Residual {
  Eigen::Matrix<double, 6, 1> jacobian;  // translation [1], rotation [m]
  double distance = 0;                   // [m] from the place's plane
  Eigen::Vector3d at;                    // in the place's frame [m]
};

/// Computes Registration::information from at least one pair. `hessian` is the sum of J J^T.
Eigen::Matrix<double, 6, 6> information_of(const std::vector<Residual>& residuals,
                                           const Eigen::Matrix<double, 6, 6>& hessian);

}  // namespace revisit
