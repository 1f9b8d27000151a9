#pragma once

#include <Eigen/Core>
#include <string>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// Sign choices of the principal directions (paper, III-A): case 2 is case 1 turned by 180 degrees.
enum class AlignCase { kNone, kOne, kTwo };  // kNone: the points as they are

/// "none", "case1", "case2"; throws UsageError for anything else.
AlignCase parse_align_case(const std::string& text);
const char* name_of(AlignCase mode);

/// The rotation that brings a cloud to its principal directions, and how far to trust it.
struct Alignment {
  Eigen::Matrix3f R_aligned_sensor =
      Eigen::Matrix3f::Identity();                        // rows: x', y', z' in the sensor frame
  Eigen::Vector3f eigenvalues = Eigen::Vector3f::Zero();  // l1 >= l2 >= l3 [m^2]
  float eigenvalue_ratio = 0;    // l1/l2; near 1: the direction is not determined
  float abs_t11 = 0;             // |t11|; near 0: the sign, so the direction, may flip
  bool mirrored_choice = false;  // case 1 wants t22 >= 0, which here only a mirror could give
  float yaw = 0;                 // of x' in the sensor frame [rad], counter-clockwise from x
};

/// Principal directions of the covariance about the mean; the rotation is about the sensor origin.
/// z' points up (t33 >= 0), x' has t11 >= 0 in case 1, y' = z' x x'. kNone gives case 1's.
/// Throws InputError when fewer than 3 usable points are left or they are all the same.
Alignment principal_alignment(const PointCloud& cloud, AlignCase which = AlignCase::kOne);

/// Applies a rotation about the sensor origin to every point.
PointCloud rotated(const PointCloud& cloud, const Eigen::Matrix3f& R);

}  // namespace revisit::pipeline
