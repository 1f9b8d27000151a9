#pragma once

#include <Eigen/Core>
#include <vector>

#include "revisit/recognition/ring/describe.h"

namespace revisit {

/// Projection of a ring's Fourier coefficients: [frequency], [kept][features].
using RingProjection = std::vector<Eigen::MatrixXcf>;

/// Computes the most discriminative directions for `numbers` real dimensions of a descriptor: one
/// per direction at frequency 0, two at others. T_f is the total covariance plus, for f > 0, the
/// mean's M_f M_f^H. With pairs: B_f v = l (T_f + eps tr(T_f)/d 1) v, V^H T V = 1, weighted by
/// sqrt(l), largest l first. Without pairs: T_f^-0.3, largest variance first.
RingProjection project_rings(const RingStatistics& ring, double regularization, int numbers);

double trace(const std::vector<Eigen::MatrixXcd>& spreads);

}  // namespace revisit
