#include <pcl/console/print.h>
#include <pcl/registration/gicp.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "check_options.h"
#include "coarse_pose.h"
#include "pcl/prepared_scan.h"
#include "revisit/proto/error.h"

namespace revisit::pipeline {
namespace {

using Gicp = pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

Eigen::Isometry3d refined(const Eigen::Isometry3d& start, const PreparedScan::Parts& query,
                          const PreparedScan::Parts& place, double max_distance) {
  // PCL prints its complaints; a registration that failed has no inliers.
  [[maybe_unused]] static const bool silent = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  Gicp gicp;
  gicp.setInputSource(query.points);
  gicp.setInputTarget(place.points);
  gicp.setSearchMethodSource(query.tree, /*force_no_recompute=*/true);
  gicp.setSearchMethodTarget(place.tree, /*force_no_recompute=*/true);
  gicp.setSourceCovariances(query.covariances);
  gicp.setTargetCovariances(place.covariances);
  gicp.setMaxCorrespondenceDistance(max_distance);
  gicp.setMaximumIterations(20);
  gicp.setTransformationEpsilon(5e-3);  // [m]
  gicp.setRotationEpsilon(1e-4);
  Points moved;
  gicp.align(moved, start.matrix().cast<float>());
  const Eigen::Matrix4d end = gicp.getFinalTransformation().cast<double>();
  if (!end.allFinite()) return start;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::Quaterniond(Eigen::Matrix3d(end.topLeftCorner<3, 3>()))
                      .normalized()
                      .toRotationMatrix();  // of floats, which are not quite a rotation
  pose.translation() = end.topRightCorner<3, 1>();
  return pose;
}

/// Fills in all but the pose and whether it is accepted.
void judge(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
           double inlier_distance, Registration* result) {
  constexpr double kLikeNormals = 0.9;  // cosine
  constexpr double kLeastSigma = 0.01;  // no LiDAR and no thinned surface is better [m]
  const Eigen::Isometry3d& T = result->T_place_query;
  const Eigen::Matrix3d R_query_place = T.linear().transpose();
  double squares = 0, residuals = 0;
  int64_t inliers = 0, upright_inliers = 0, like = 0;
  Matrix6d hessian = Matrix6d::Zero();
  pcl::Indices nearest(1);
  std::vector<float> squared_distance(1);
  for (size_t i = 0; i < query.points->size(); ++i) {
    const Eigen::Vector3d q = (*query.points)[i].getVector3fMap().cast<double>();
    const Eigen::Vector3d moved = T * q;
    pcl::PointXYZ point;
    point.getVector3fMap() = moved.cast<float>();
    place.tree->nearestKSearch(point, 1, nearest, squared_distance);
    const double squared = static_cast<double>(squared_distance[0]);
    if (!(squared <= inlier_distance * inlier_distance)) continue;
    ++inliers;
    squares += squared;
    upright_inliers += is_upright(query.normals[i]) ? 1 : 0;

    const auto at = static_cast<size_t>(nearest[0]);
    const Eigen::Vector3d normal = place.normals[at].cast<double>();
    const Eigen::Vector3d turned = R_query_place * normal;
    if (std::abs(turned.dot(query.normals[i].cast<double>())) < kLikeNormals) continue;
    ++like;
    residuals +=
        std::pow(normal.dot(moved - (*place.points)[at].getVector3fMap().cast<double>()), 2);
    Vector6d jacobian;
    jacobian << turned, q.cross(turned);
    hessian += jacobian * jacobian.transpose();
  }
  if (inliers > 0) result->fitness = squares / static_cast<double>(inliers);
  if (!query.upright.empty())
    result->inliers =
        static_cast<double>(upright_inliers) / static_cast<double>(query.upright.size());
  if (like == 0) return;
  const double variance =
      std::max(residuals / static_cast<double>(like), kLeastSigma * kLeastSigma);
  result->information = hessian / variance;
  const Eigen::Matrix3d translation = hessian.topLeftCorner<3, 3>();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(translation);
  result->constraint = std::max(0.0, solver.eigenvalues()[0] / translation.trace());
}

}  // namespace

Registration register_scans(const PreparedScan& query_scan, const PreparedScan& place_scan,
                            double turn, const RegistrationOptions& options) {
  check(options);
  if (!std::isfinite(turn))
    throw UsageError(str("register_scans: expected a finite turn, found ", turn));
  const PreparedScan::Parts& query = query_scan.parts();
  const PreparedScan::Parts& place = place_scan.parts();
  Registration result;
  result.T_place_query.linear() =
      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  if (std::min(query.points->size(), place.points->size()) < kLeastPoints) return result;

  const Eigen::Isometry3d start = coarse_pose(query.upright, place.upright, turn, options.reach,
                                              std::max(query.range, place.range));
  result.T_place_query = refined(start, query, place, options.max_distance);
  judge(query, place, options.inlier_distance, &result);
  result.accepted =
      result.inliers >= options.least_inliers && result.constraint >= options.least_constraint;
  return result;
}

}  // namespace revisit::pipeline
