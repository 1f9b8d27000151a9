#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Sign choices of the principal directions (paper, III-A). Case 2 is case 1 rotated by 180 degrees
/// about z'.
enum class AlignCase { kNone, kOne, kTwo };  ///< kNone: points unchanged

/// Parses "none", "case1" or "case2"; throws UsageError for anything else.
AlignCase parse_align_case(const std::string& text);
const char* name_of(AlignCase mode);  ///< inverse of parse_align_case()

/// Rotation of a scan to its principal directions.
struct Alignment {
  Eigen::Matrix3f R_aligned_sensor =
      Eigen::Matrix3f::Identity();                        ///< rows: x', y', z' in the sensor frame
  Eigen::Vector3f eigenvalues = Eigen::Vector3f::Zero();  ///< l1 >= l2 >= l3 [m^2]
  float eigenvalue_ratio = 0;    ///< l1/l2; near 1: the direction is ambiguous
  float abs_t11 = 0;             ///< |t11|; near 0: the sign of the direction is ambiguous
  bool mirrored_choice = false;  ///< case 1 requires t22 >= 0, which here needs a mirror image
  float yaw = 0;                 ///< yaw of x' in the sensor frame [rad], counter-clockwise from x
};

/// Computes principal directions of the covariance about the mean; the rotation is about the sensor
/// origin. z' points up (t33 >= 0), x' has t11 >= 0 in case 1, and y' = z' x x'. kNone returns the
/// alignment of case 1. Throws InputError if fewer than 3 points are usable or all are equal.
Alignment principal_alignment(const PointCloud& cloud, AlignCase which = AlignCase::kOne);

PointCloud rotated(const PointCloud& cloud, const Eigen::Matrix3f& R);  ///< R times each point

/// Parses "roll,pitch,yaw,x,y,z" in degrees and meters: the transform from the scan's frame to a
/// frame with x forward, y left and z up. It rotates about the x, y and z axis, in this order, then
/// translates. Throws UsageError for anything else.
Eigen::Isometry3d parse_mount(const std::string& text);

/// Leaves points without a return unchanged.
void transform(const Eigen::Isometry3d& T, PointCloud& cloud);

/// Returns the defect and its fix, or "": half of the points are farther than 500 m.
std::string find_unit_defect(const PointCloud& cloud);

/// Returns the defect and its fix, or "": camera axes, a sensor mounted upside down, or points in a
/// map frame (some scans lie far from its origin).
std::string find_view_defect(const std::vector<PointCloud>& scans);

}  // namespace revisit
