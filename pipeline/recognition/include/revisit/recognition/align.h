#pragma once

#include <Eigen/Core>
#include <string>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Sign choices of the principal directions (paper, III-A). Case 2 is case 1 rotated by 180 degrees
/// about z'.
enum class AlignCase { kNone, kOne, kTwo };  // kNone: points unchanged

/// Parses "none", "case1" or "case2"; throws UsageError for anything else.
AlignCase parse_align_case(const std::string& text);
const char* name_of(AlignCase mode);

struct Alignment {
  Eigen::Matrix3f R_aligned_sensor =
      Eigen::Matrix3f::Identity();                        // rows: x', y', z' in the sensor frame
  Eigen::Vector3f eigenvalues = Eigen::Vector3f::Zero();  // l1 >= l2 >= l3 [m^2]
  float eigenvalue_ratio = 0;    // l1/l2; near 1: the direction is ambiguous
  float abs_t11 = 0;             // |t11|; near 0: the sign of the direction is ambiguous
  bool mirrored_choice = false;  // case 1 requires t22 >= 0, which here needs a mirror image
  float yaw = 0;                 // yaw of x' in the sensor frame [rad], counter-clockwise from x
};

/// Computes principal directions of the covariance about the mean; the rotation is about the sensor
/// origin. z' points up (t33 >= 0), x' has t11 >= 0 in case 1, and y' = z' x x'. kNone returns the
/// alignment of case 1. Throws InputError if fewer than 3 points are usable or all are equal.
Alignment principal_alignment(const PointCloud& cloud, AlignCase which = AlignCase::kOne);

PointCloud rotated(const PointCloud& cloud, const Eigen::Matrix3f& R);

}  // namespace revisit
