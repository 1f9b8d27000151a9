#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "prepared_scan.h"
#include "revisit/base/error.h"

namespace revisit {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

struct Residual {
  Vector6d jacobian;    // translation [1], rotation [m]
  double distance = 0;  // [m] from the place's plane
  Eigen::Vector3d at;   // in the place's frame [m]
};

constexpr double kPatch = 16;  // edge of a patch, in which errors are correlated [m]

uint64_t patch_of(const Eigen::Vector3d& at) {
  uint64_t key = 0;
  for (const double x : at) key = key << 21 | static_cast<uint64_t>(std::floor(x / kPatch) + 1e6);
  return key;
}

/// Sum of g g^T over patches, with g the sum of J r in a patch. `patches`: their number.
Matrix6d scatter_of(const std::vector<Residual>& residuals, int64_t* patches) {
  std::vector<std::pair<uint64_t, const Residual*>> sorted;
  sorted.reserve(residuals.size());
  for (const Residual& residual : residuals) sorted.emplace_back(patch_of(residual.at), &residual);
  std::ranges::stable_sort(sorted, {}, &std::pair<uint64_t, const Residual*>::first);
  Matrix6d scatter = Matrix6d::Zero();
  *patches = 0;
  for (auto at = sorted.begin(); at != sorted.end(); ++*patches) {
    Vector6d sum = Vector6d::Zero();
    for (const uint64_t patch = at->first; at != sorted.end() && at->first == patch; ++at)
      sum += at->second->distance * at->second->jacobian;
    scatter += sum * sum.transpose();
  }
  return scatter;
}

/// Computes Registration::information from at least one pair. `hessian` is the sum of J J^T.
Matrix6d information_of(const std::vector<Residual>& residuals, const Matrix6d& hessian) {
  // Chosen on pairs of simulated drives. Pairing with the nearest point hides half of the variance
  // (kHidden). Errors common to all points, which no patch shows, come from the acceleration during
  // a scan: deskewing by the preceding motion errs by 13 mm and 0.1 degrees for KITTI's cars. Half
  // of it moves the scan, 0.7 of it a pair.
  constexpr double kHidden = 2;
  constexpr double kTranslation = 0.01;  // [m]
  constexpr double kRotation = 1e-3;     // [rad]
  int64_t patches = 0;
  Matrix6d scatter = scatter_of(residuals, &patches);
  const auto n = static_cast<double>(patches);
  scatter *= kHidden * n / std::max(1.0, n - 6);  // degrees of freedom: 6 for the fitted pose
  Vector6d shared;
  shared << Eigen::Vector3d::Constant(kTranslation * kTranslation),
      Eigen::Vector3d::Constant(kRotation * kRotation);
  // (H^-1 S H^-1 + F)^-1 without H^-1, because H may be singular; the result is 0 there.
  scatter += hessian * shared.asDiagonal() * hessian;
  scatter.diagonal().array() += 1e-12 * (1 + scatter.trace());
  const Matrix6d information = hessian * scatter.ldlt().solve(hessian);
  return (information + information.transpose()) / 2;
}

/// Minimum denominator of the inlier ratio, because fewer points may fit anywhere. Beside a lorry a
/// scan had 27 points, which all fitted a place 92 m away.
constexpr size_t kMinNonGround = 200;

struct Pair {
  uint32_t place = 0;
  float squared = std::numeric_limits<float>::infinity();  // [m^2]; infinite without a pair
  // Position of the query's point when the pair was found.
  Eigen::Vector3f at = Eigen::Vector3f::Zero();
  float slack = -1;  // the pair stays valid within this distance from `at` [m]
  float reach = 0;   // two points are within this distance from `at`; 0: not known [m]
};

/// Pairs every `stride`th query point with the nearest place point closer than `limit` [m]. Pairs
/// of an earlier T that are certainly still valid are not searched again.
void pair_points(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
                 const Eigen::Isometry3d& T, float limit, size_t stride, std::vector<Pair>* pairs) {
  std::array<Neighbor, 2> found;
  for (size_t i = 0; i < pairs->size(); i += stride) {
    Pair& pair = (*pairs)[i];
    const Eigen::Vector3f moved = (T * query.points[i].cast<double>()).cast<float>();
    if ((moved - pair.at).norm() < pair.slack) {
      pair.squared = (moved - place.points[pair.place]).squaredNorm();
      continue;
    }
    float most = limit;
    if (pair.reach > 0) most = std::min(most, pair.reach + (moved - pair.at).norm() + 1e-3F);
    pair = {};
    const size_t count = place.tree->nearest(moved, most * most, found);
    if (count == 0) continue;
    const float second = count == 2 ? std::sqrt(found[1].squared) : limit;
    pair = {found[0].point, found[0].squared, moved, (second - std::sqrt(found[0].squared)) / 2,
            count == 2 ? second : 0};
  }
}

/// Gauss-Newton step (t, w) of generalized ICP, from T to T * (t, exp(w)).
Vector6d step_of(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
                 const Eigen::Isometry3d& T, size_t stride, const std::vector<Pair>& pairs) {
  // Ratio of the variances along the normal and along the surface, as in the paper.
  constexpr double kFlatness = 1e-3;
  const Eigen::Isometry3d T_query_place = T.inverse();
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian.leftCols<3>().setIdentity();
  for (size_t i = 0; i < pairs.size(); i += stride) {
    if (std::isinf(pairs[i].squared)) continue;
    const uint32_t at = pairs[i].place;
    const Eigen::Vector3d q = query.points[i].cast<double>();
    const Eigen::Vector3d n = query.normals[i].cast<double>();
    const Eigen::Vector3d m = T_query_place.linear() * place.normals[at].cast<double>();
    const Eigen::Matrix3d covariance =
        2 * Eigen::Matrix3d::Identity() - (1 - kFlatness) * (n * n.transpose() + m * m.transpose());
    jacobian.rightCols<3>() << 0, q.z(), -q.y(), -q.z(), 0, q.x(), q.y(), -q.x(), 0;
    const Eigen::Matrix<double, 6, 3> weighted = jacobian.transpose() * covariance.inverse();
    hessian += weighted * jacobian;
    gradient += weighted * (q - T_query_place * place.points[at].cast<double>());
  }
  // No step in unconstrained directions.
  hessian.diagonal().array() += 1e-9 * (1 + hessian.trace());
  return -hessian.ldlt().solve(gradient);
}

/// True if fewer than `least` of the query's upright points have a pair within the inlier distance,
/// by every `stride`th point.
bool is_hopeless(const PreparedScan::Parts& query, const std::vector<Pair>& pairs, size_t stride,
                 float inlier_distance, double least) {
  size_t inliers = 0;
  for (size_t i = 0; i < pairs.size(); i += stride)
    if (pairs[i].squared <= inlier_distance * inlier_distance && is_non_ground(query.normals[i]))
      inliers += stride;
  return static_cast<double>(inliers) <
         least * static_cast<double>(std::max(query.upright.size(), kMinNonGround));
}

/// Generalized ICP: first with about 1500 points until steps are small, then with all. Ends early
/// if so few points fit that the rest could not make up for it: most other places end there.
Eigen::Isometry3d fitted(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
                         const Eigen::Isometry3d& start, const RegistrationOptions& options,
                         std::vector<Pair>* pairs) {
  constexpr int kMaxSteps = 30;
  constexpr int kTrial = 8;  // steps after which half of the inliers are found
  constexpr double kAtTrial = 0.5, kAtEnd = 0.75;  // of the minimum inlier ratio
  constexpr double kTranslation = 1e-3;            // minimum step [m]
  constexpr double kRotation = 1e-4;               // [rad]
  const auto max_distance = static_cast<float>(options.max_distance);
  const auto is_lost = [&](size_t stride, double part) {
    return is_hopeless(query, *pairs, stride, static_cast<float>(options.inlier_distance),
                       part * options.min_inlier_ratio);
  };
  Eigen::Isometry3d T = start;
  for (const bool all : {false, true}) {
    const size_t stride = all ? 1 : std::max<size_t>(1, pairs->size() / 1500);
    const double loose = all ? 1 : 10;
    for (int i = 0; i < kMaxSteps; ++i) {
      pair_points(query, place, T, max_distance, stride, pairs);
      if (!all && i >= kTrial && is_lost(stride, kAtTrial)) return T;
      const Vector6d step = step_of(query, place, T, stride, *pairs);
      const double angle = step.tail<3>().norm();
      T.translate(step.head<3>());
      T.rotate(Eigen::AngleAxisd(angle, step.tail<3>().normalized()));
      if (step.head<3>().norm() < loose * kTranslation && angle < loose * kRotation) break;
    }
    if (!all && is_lost(stride, kAtEnd)) return T;
  }
  return T;
}

/// Sets everything except the pose and `fits`.
void evaluate(const PreparedScan::Parts& query, const PreparedScan::Parts& place,
              double inlier_distance, const std::vector<Pair>& pairs, Registration* result) {
  constexpr double kLikeNormals = 0.9;  // cosine
  const Eigen::Isometry3d& T = result->T_place_query;
  const Eigen::Matrix3d R_query_place = T.linear().transpose();
  double squares = 0;
  int64_t inliers = 0, upright_inliers = 0;
  std::vector<Residual> residuals;
  Matrix6d hessian = Matrix6d::Zero();
  for (size_t i = 0; i < query.points.size(); ++i) {
    const Eigen::Vector3d q = query.points[i].cast<double>();
    const Eigen::Vector3d moved = T * q;
    const double squared = static_cast<double>(pairs[i].squared);
    if (!(squared <= inlier_distance * inlier_distance)) continue;
    ++inliers;
    squares += squared;
    upright_inliers += is_non_ground(query.normals[i]) ? 1 : 0;

    const uint32_t at = pairs[i].place;
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
  result->inlier_ratio = static_cast<double>(upright_inliers) /
                         static_cast<double>(std::max(query.upright.size(), kMinNonGround));
  if (residuals.empty()) return;
  result->information = information_of(residuals, hessian);
  const Eigen::Matrix3d translation = hessian.topLeftCorner<3, 3>();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(translation);
  result->constraint = std::max(0.0, solver.eigenvalues()[0] / translation.trace());
}

}  // namespace

Registration register_scans(const PreparedScan& query_scan, const PreparedScan& place_scan,
                            double relative_yaw, const RegistrationOptions& options) {
  check(options);
  if (!std::isfinite(relative_yaw))
    throw UsageError("register_scans(): expected a finite relative yaw, found ", relative_yaw);
  const PreparedScan::Parts& query = query_scan.parts();
  const PreparedScan::Parts& place = place_scan.parts();
  Registration result;
  result.T_place_query.linear() =
      Eigen::AngleAxisd(relative_yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  if (std::min(query.points.size(), place.points.size()) < kMinPoints) return result;

  const Eigen::Isometry3d start =
      coarse_pose(query.upright, place.upright, relative_yaw, options.search_radius,
                  std::max(query.range, place.range));
  const auto max_distance = static_cast<float>(options.max_distance);
  const auto inlier_distance = static_cast<float>(options.inlier_distance);
  std::vector<Pair> pairs(query.points.size());
  result.T_place_query = fitted(query, place, start, options, &pairs);
  pair_points(query, place, result.T_place_query, std::max(max_distance, inlier_distance), 1,
              &pairs);
  evaluate(query, place, options.inlier_distance, pairs, &result);
  result.fits = result.inlier_ratio >= options.min_inlier_ratio &&
                result.constraint >= options.min_constraint;
  return result;
}

}  // namespace revisit
