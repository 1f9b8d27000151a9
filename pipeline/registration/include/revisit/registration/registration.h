#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// The defaults were chosen on a simulated town seen by an HDL-64E, and `least_inliers` also on
/// NCLT and MulRan Riverside, where 0.3 to 0.5 let the same wrong pairs through.
struct RegistrationOptions {
  double voxel = 0.4;              ///< points are thinned to one a voxel, 0.05 to 5 [m]
  double max_range = 60;           ///< farther points are left out, up to 200 [m]
  double reach = 6;                ///< of the search for a start, forward and sideways, 0 to 20 [m]
  double max_distance = 1;         ///< of points that GICP pairs [m]
  double inlier_distance = 0.3;    ///< of points that are taken to be the same [m]
  double least_inliers = 0.4;      ///< to be accepted
  double least_constraint = 0.02;  ///< to be accepted; see Registration::constraint
};

/// A scan thinned, with its search tree and its surface normals: as query and as place. Copies
/// share what they hold. May be used by several threads at once.
class PreparedScan {
 public:
  /// Throws UsageError for invalid options. A scan of few or no points is no error: its
  /// registrations are not accepted.
  explicit PreparedScan(const PointCloud& cloud, const RegistrationOptions& options = {});
  int64_t size() const;                                 ///< points left
  const std::vector<Eigen::Vector3f>& points() const;   ///< in the sensor's frame [m]
  const std::vector<Eigen::Vector3f>& normals() const;  ///< [point], of either sign

  struct Parts;
  const Parts& parts() const { return *parts_; }  ///< what register_scans() sees

 private:
  std::shared_ptr<const Parts> parts_;
};

/// How a query lies to a place, and whether it is one.
struct Registration {
  /// Takes points of the query's sensor frame to the place's (x forward, y left, z up) [m].
  Eigen::Isometry3d T_place_query = Eigen::Isometry3d::Identity();

  /// Inverse covariance of (t, w), translation first: the true pose is T_place_query * (t, exp(w)),
  /// t [m] and w [rad] in the query's frame. Units 1/m^2, 1/rad^2 and 1/(m rad). g2o's
  /// EDGE_SE3:QUAT has the same order and frame, but the quaternion's vector, half of w: multiply
  /// rows and columns of w by 2. Errors of neighbouring points are alike, so the covariance is the
  /// cluster-robust one (Liang and Zeger, Biometrika 1986) of point-to-plane ICP (Chen and Medioni
  /// 1991): 2 H^-1 (sum over patches of g g^T) H^-1 + F. Over inliers of like normals n, with the
  /// residual r = n . (T q - p) and its Jacobian J, H is the sum of J J^T, and g that of J r in a
  /// patch, a cube of 16 m. F is what patches do not show: 2 mm and 1e-4 rad. Over 200 simulated
  /// pairs the normalised error squared has a mean within a factor of 2 of the 6 that it should
  /// have (docs/SLAM.md). Real scans that are distorted by motion are not that good.
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();

  double mean_squared_distance = 0;  ///< of the inliers [m^2]; 0 without any

  /// Share of the query's upright points (walls, trunks, cars) with a point of the place within
  /// `inlier_distance`, 0 to 1. Ground is left out: it fits everywhere. Fewer than 200 upright
  /// points count as 200.
  double inlier_ratio = 0;

  /// Of the translation's part of H, the least direction's share, 0 to 1/3. Along a corridor, or
  /// within a lone plane, nothing holds the scans: near 0.
  double constraint = 0;

  bool accepted = false;  ///< enough inliers, and held in all directions
};

/// Registers a query with a place seen under another heading. First the shift within `reach`, and
/// the turn within 3 degrees, under which upright points meet best, seen from above; from there
/// generalized ICP (Segal, Haehnel and Thrun, RSS 2009). Equal input gives equal output, on one
/// thread. `turn`: heading of the query less that of the place, counter-clockwise [rad]. Throws
/// UsageError for invalid options or an invalid turn.
Registration register_scans(const PreparedScan& query, const PreparedScan& place, double turn,
                            const RegistrationOptions& options = {});

}  // namespace revisit::pipeline
