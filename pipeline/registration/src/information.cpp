#include "information.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>

namespace revisit {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

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

}  // namespace

Matrix6d information_of(const std::vector<Residual>& residuals, const Matrix6d& hessian) {
  // Chosen on pairs of five simulated drives. Pairing with the nearest point hides half of the
  // variance (kHidden). Errors common to all points, which patches do not show, come from
  // downsampling and from ending the iterations at small steps.
  constexpr double kHidden = 2;
  constexpr double kTranslation = 0.002;  // [m]
  constexpr double kRotation = 1e-4;      // [rad]
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

}  // namespace revisit
