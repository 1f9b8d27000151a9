#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "coarse_pose.h"
#include "information.h"
#include "prepared_scan.h"
#include "revisit/base/error.h"

namespace revisit::pipeline {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// `start` when there is no pose; the rotation of what was computed in float is not quite one.
Eigen::Isometry3d proper(const Eigen::Isometry3d& pose, const Eigen::Isometry3d& start) {
  if (!pose.matrix().allFinite()) return start;
  Eigen::Isometry3d result = pose;
  result.linear() =
      Eigen::Quaterniond(Eigen::Matrix3d(pose.linear())).normalized().toRotationMatrix();
  return result;
}

/// Fills in all but the pose and whether it is accepted.
void judge(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
           double inlier_distance, Registration* result) {
  constexpr double kLikeNormals = 0.9;  // cosine
  const Eigen::Isometry3d& T = result->T_place_query;
  const Eigen::Matrix3d R_query_place = T.linear().transpose();
  double squares = 0;
  int64_t inliers = 0, upright_inliers = 0;
  std::vector<Residual> residuals;
  Matrix6d hessian = Matrix6d::Zero();
  std::vector<uint32_t> nearest;
  std::vector<float> squared_distance;
  for (size_t i = 0; i < query.points.size(); ++i) {
    const Eigen::Vector3d q = query.points[i].cast<double>();
    const Eigen::Vector3d moved = T * q;
    place.tree->nearest(moved.cast<float>(), 1, &nearest, &squared_distance);
    const double squared = static_cast<double>(squared_distance[0]);
    if (!(squared <= inlier_distance * inlier_distance)) continue;
    ++inliers;
    squares += squared;
    upright_inliers += is_upright(query.normals[i]) ? 1 : 0;

    const uint32_t at = nearest[0];
    const Eigen::Vector3d normal = place.normals[at].cast<double>();
    const Eigen::Vector3d turned = R_query_place * normal;
    if (std::abs(turned.dot(query.normals[i].cast<double>())) < kLikeNormals) continue;
    Residual& residual = residuals.emplace_back();
    residual.jacobian << turned, q.cross(turned);
    residual.distance = normal.dot(moved - place.points[at].cast<double>());
    residual.at = moved;
    hessian += residual.jacobian * residual.jacobian.transpose();
  }
  if (inliers > 0) result->mean_squared_distance = squares / static_cast<double>(inliers);
  if (!query.upright.empty())
    result->inlier_ratio =
        static_cast<double>(upright_inliers) / static_cast<double>(query.upright.size());
  if (residuals.empty()) return;
  result->information = information_of(residuals, hessian);
  const Eigen::Matrix3d translation = hessian.topLeftCorner<3, 3>();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(translation);
  result->constraint = std::max(0.0, solver.eigenvalues()[0] / translation.trace());
}

}  // namespace

Registration register_scans(const PreparedScan& query_scan, const PreparedScan& place_scan,
                            double turn, const RegistrationOptions& options, const Refine& refine) {
  check(options);
  if (!std::isfinite(turn))
    throw UsageError("register_scans: expected a finite turn, found ", turn);
  const PreparedScan::Parts& query = query_scan.parts();
  const PreparedScan::Parts& place = place_scan.parts();
  Registration result;
  result.T_place_query.linear() =
      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  if (std::min(query.points.size(), place.points.size()) < kLeastPoints) return result;

  const Eigen::Isometry3d start = coarse_pose(query.upright, place.upright, turn, options.reach,
                                              std::max(query.range, place.range));
  result.T_place_query = proper(refine(start), start);
  judge(query, place, options.inlier_distance, &result);
  result.accepted =
      result.inlier_ratio >= options.least_inliers && result.constraint >= options.least_constraint;
  return result;
}

}  // namespace revisit::pipeline
