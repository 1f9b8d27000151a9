#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Defaults chosen on a simulated town with an HDL-64E, `min_inlier_ratio` also on NCLT and MulRan
/// Riverside, where all values from 0.3 to 0.5 accept the same incorrect pairs.
struct RegistrationOptions {
  double voxel_size = 0.4;  ///< edge of the voxels for downsampling, 0.05 to 5 [m]
  double max_range = 60;    ///< farther points are ignored; at most 200 [m]
  /// Search radius for the initial shift, along x and y, 0 to 20 [m]
  double search_radius = 6;
  double max_distance = 1;        ///< maximum correspondence distance of GICP [m]
  double inlier_distance = 0.3;   ///< maximum distance of an inlier [m]
  double min_inlier_ratio = 0.4;  ///< of Registration::inlier_ratio, to fit
  double min_constraint = 0.02;   ///< of Registration::constraint, to fit
};

/// A downsampled scan with its search tree and surface normals, for use as query or place. Copies
/// share their data. Immutable, so several threads may use it at once.
class PreparedScan {
 public:
  /// Throws UsageError for invalid options. A scan with few or no points is valid, but never
  /// fits.
  explicit PreparedScan(const PointCloud& cloud, const RegistrationOptions& options = {});
  /// Points after downsampling, in the sensor's frame [m].
  const std::vector<Eigen::Vector3f>& points() const;
  const std::vector<Eigen::Vector3f>& normals() const;  ///< one per point, of either sign

  struct Parts;
  const Parts& parts() const { return *parts_; }  ///< for register_scans()

 private:
  std::shared_ptr<const Parts> parts_;
};

/// Relative pose of a query to a place.
struct Registration {
  /// Transforms points from the query's sensor frame to the place's (x forward, y left, z up) [m].
  Eigen::Isometry3d T_place_query = Eigen::Isometry3d::Identity();

  /// Inverse covariance of (t, w), translation first: the true pose is T_place_query * (t, exp(w)),
  /// with t [m] and w [rad] in the query's frame. Units 1/m^2, 1/rad^2 and 1/(m rad). g2o's
  /// EDGE_SE3:QUAT has the same order and frame, but the vector part of the quaternion, half of w:
  /// multiply rows and columns of w by 2.
  /// Errors of neighboring points are correlated. The covariance is therefore the cluster-robust
  /// one (Liang and Zeger, Biometrika 1986) of point-to-plane ICP (Chen and Medioni 1991): 2 H^-1
  /// (sum over patches of g g^T) H^-1 + F. An inlier with the normal n has the residual
  /// r = n . (T q - p) and its Jacobian J; H is the sum of J J^T, and g that of J r in a patch, a
  /// cube of 16 m. Only inliers whose normals agree in both scans count. F, for errors common to
  /// all patches, has standard deviations of 10 mm and 1e-3 rad: what the acceleration of a car
  /// during a scan leaves after deskewing. With it the mean NEES is within a factor of 2 of the
  /// ideal 6 (docs/RESULTS.md); instantaneous scans have smaller errors, scans that are not
  /// deskewed larger ones.
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();

  double mean_squared_distance = 0;  ///< mean over the inliers [m^2]; 0 without any

  /// Fraction of the query's non-ground points (walls, trunks, cars) with a point of the place
  /// within `inlier_distance`, 0 to 1. Ground points are ignored, because they fit everywhere. The
  /// denominator is at least 200.
  double inlier_ratio = 0;

  /// Smallest eigenvalue over trace of the translational block of H, 0 to 1/3. Near 0 in degenerate
  /// scenes: along a corridor, or with a single plane.
  double constraint = 0;

  bool fits = false;  ///< enough inliers, and constrained in all directions
};

/// Searches top-down over shifts within `search_radius` and rotations within 3 degrees for the
/// largest overlap of non-ground points; generalized ICP (Segal, Haehnel and Thrun, RSS 2009)
/// refines the result, unless hardly any points coincide. Deterministic and single-threaded.
/// `relative_yaw`: yaw(query) - yaw(place), CCW [rad]. Throws UsageError for invalid options or an
/// invalid relative_yaw.
Registration register_scans(const PreparedScan& query, const PreparedScan& place,
                            double relative_yaw, const RegistrationOptions& options = {});

/// Mean of the points of each voxel of edge `voxel` [m], within `range` [m].
PointCloud thinned_cloud(const PointCloud& cloud, double voxel, double range);

/// Median range of the upright points (walls, trunks, cars) over 16 m, at least 0.3 and at most 1;
/// 1 without any. Of default options.
double scene_scale(const PreparedScan& scan);

/// At most about 24 kB: the mean of each voxel within 60 m, quantized to 1/32 m. Voxels have 0.4 m
/// times `scale`; absent: scene_scale() of the cloud. Of more than 12,000 points, larger voxels and
/// 1/16 m.
std::string compact_cloud(const PointCloud& cloud,
                          const Eigen::Isometry3d& mount = Eigen::Isometry3d::Identity(),
                          std::optional<double> scale = std::nullopt);

/// Decodes compact_cloud(): points with x forward, y left and z up, and the mount, which transforms
/// points from the sensor's frame to this one. Throws InputError for other bytes.
std::pair<PointCloud, Eigen::Isometry3d> expand_cloud(std::string_view bytes);

}  // namespace revisit
