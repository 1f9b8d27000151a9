#pragma once

#include <Eigen/Core>
#include <vector>

#include "revisit/recognition/ring/describe.h"

namespace revisit::pipeline {

/// What a ring's coefficients are multiplied by: [frequency] of [kept][numbers].
using RingProjection = std::vector<Eigen::MatrixXcf>;

/// The directions that tell places apart best, for `numbers` real numbers of a descriptor: one each
/// at frequency 0, two at others. T_f is the total spread plus, for f > 0, the mean's M_f M_f^H.
/// Learnt from pairs: B_f v = l (T_f + eps tr(T_f)/d 1) v, V^H T V = 1, weighted by sqrt(l),
/// largest l first. From scans alone: T_f^-0.3, largest variance first.
RingProjection project_rings(const RingStatistics& ring, double regularisation, int numbers);

/// The sum of the traces of all frequencies.
double trace(const std::vector<Eigen::MatrixXcd>& spreads);

}  // namespace revisit::pipeline
