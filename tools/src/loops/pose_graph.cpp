#include "pose_graph.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace revisit::cli {
namespace {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Poses = std::vector<Eigen::Isometry3d>;

constexpr double kKernel = 3;  // of both kernels, in standard deviations

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// The step (t, w) of T -> T * (t, exp(w)).
Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vector6d& step) {
  const double angle = step.tail<3>().norm();
  Eigen::Isometry3d motion(Eigen::Translation3d(step.head<3>()));
  if (angle > 0) motion.rotate(Eigen::AngleAxisd(angle, step.tail<3>() / angle));
  Eigen::Isometry3d result = T * motion;
  result.linear() = Eigen::Quaterniond(result.linear()).normalized().toRotationMatrix();
  return result;
}

struct Residual {
  Vector6d error;  // (t, w)
  Matrix6d by_from, by_to;

  Residual(const PoseEdge& edge, const Poses& poses) {
    const Eigen::Isometry3d between = poses[edge.from].inverse() * poses[edge.to];
    const Eigen::Isometry3d E = edge.T_from_to.inverse() * between, back = between.inverse();
    const Eigen::AngleAxisd turn(E.linear());
    error << E.translation(), turn.angle() * turn.axis();
    by_to.setZero();
    by_to.topLeftCorner<3, 3>() = E.linear();
    by_to.bottomRightCorner<3, 3>() =
        Eigen::Matrix3d::Identity() + 0.5 * cross(Eigen::Vector3d(error.tail<3>()));
    Matrix6d adjoint = Matrix6d::Zero();
    adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = back.linear();
    adjoint.topRightCorner<3, 3>() = cross(back.translation()) * back.linear();
    by_from = -by_to * adjoint;
  }
};

/// Cost and weight of a loop's squared error.
std::pair<double, double> robust(double squared, bool is_huber) {
  const double limit = kKernel * kKernel;
  if (!is_huber) return {limit * std::log1p(squared / limit), 1 / (1 + squared / limit)};
  if (squared <= limit) return {squared, 1};
  const double length = std::sqrt(squared);
  return {2 * kKernel * length - limit, kKernel / length};
}

double cost_of(const std::vector<PoseEdge>& edges, const Poses& poses, bool is_huber) {
  double cost = 0;
  for (const PoseEdge& edge : edges) {
    const Vector6d error = Residual(edge, poses).error;
    const double squared = error.dot(edge.information * error);
    cost += edge.is_loop ? robust(squared, is_huber).first : squared;
  }
  return cost;
}

/// The first node of the part of each node.
std::vector<size_t> first_of_parts(const std::vector<PoseEdge>& edges, size_t nodes) {
  std::vector<size_t> first(nodes);
  std::iota(first.begin(), first.end(), size_t{0});
  const auto find = [&](size_t node) {
    while (first[node] != node) node = first[node] = first[first[node]];
    return node;
  };
  for (const PoseEdge& edge : edges) {
    const auto [least, most] = std::minmax({find(edge.from), find(edge.to)});
    first[most] = least;
  }
  for (size_t node = 0; node < nodes; ++node) first[node] = find(node);
  return first;
}

class Normal {
 public:
  explicit Normal(size_t nodes) : n_(static_cast<Eigen::Index>(6 * nodes)) {}

  void set(const std::vector<PoseEdge>& edges, const Poses& poses, bool is_huber,
           const std::vector<size_t>& fixed) {
    values_.clear();
    gradient_ = Eigen::VectorXd::Zero(n_);
    for (const PoseEdge& edge : edges) {
      const Residual at(edge, poses);
      const double squared = at.error.dot(edge.information * at.error);
      const Matrix6d weighted =
          (edge.is_loop ? robust(squared, is_huber).second : 1) * edge.information;
      const std::pair<size_t, const Matrix6d*> ends[] = {{edge.from, &at.by_from},
                                                         {edge.to, &at.by_to}};
      for (const auto& [row, by_row] : ends) {
        const Matrix6d left = by_row->transpose() * weighted;
        gradient_.segment<6>(static_cast<Eigen::Index>(6 * row)) += left * at.error;
        for (const auto& [column, by_column] : ends)
          if (column <= row) add(row, column, left * *by_column);
      }
    }
    for (size_t node = 0; node < poses.size(); ++node)
      add(node, node, (fixed[node] == node ? 1e12 : 1e-9) * Matrix6d::Identity());
    hessian_.resize(n_, n_);
    hessian_.setFromTriplets(values_.begin(), values_.end());
  }

  /// With the damping of Marquardt. Empty if there is no solution.
  Eigen::VectorXd step(double damping) {
    Eigen::SparseMatrix<double> damped = hessian_;
    damped.diagonal() *= 1 + damping;
    if (!is_analyzed_) solver_.analyzePattern(damped);
    is_analyzed_ = true;
    solver_.factorize(damped);
    if (solver_.info() != Eigen::Success) return {};
    return solver_.solve(-gradient_);
  }

 private:
  void add(size_t row, size_t column, const Matrix6d& block) {
    for (int i = 0; i < 6; ++i)
      for (int k = 0; k < 6; ++k)
        values_.emplace_back(static_cast<int>(6 * row) + i, static_cast<int>(6 * column) + k,
                             block(i, k));
  }

  const Eigen::Index n_;
  std::vector<Eigen::Triplet<double>> values_;
  Eigen::SparseMatrix<double> hessian_;  // lower triangle
  Eigen::VectorXd gradient_;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver_;
  bool is_analyzed_ = false;
};

}  // namespace

Eigen::Matrix<double, 6, 6> odometry_information(const Eigen::Isometry3d& step) {
  constexpr double kTranslation = 0.017, kRotation = 0.05 * 3.14159265358979 / 180;  // per sqrt(m)
  const double length = std::max(0.1, step.translation().norm());
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(kTranslation * kTranslation),
      Eigen::Vector3d::Constant(kRotation * kRotation);
  return (length * variances).cwiseInverse().asDiagonal();
}

void optimize(const std::vector<PoseEdge>& edges, std::vector<Eigen::Isometry3d>& poses) {
  constexpr int kMaxSteps = 50;
  constexpr double kLeastGain = 1e-6, kMostDamping = 1e6;
  const std::vector<size_t> fixed = first_of_parts(edges, poses.size());
  Normal normal(poses.size());
  for (const bool is_huber : {true, false}) {
    double cost = cost_of(edges, poses, is_huber), damping = 1e-4, gain = 1;
    for (int i = 0; i < kMaxSteps && gain > kLeastGain; ++i) {
      normal.set(edges, poses, is_huber, fixed);
      for (gain = 0; damping <= kMostDamping && gain == 0; damping *= 10) {
        const Eigen::VectorXd step = normal.step(damping);
        if (step.size() == 0 || !step.allFinite()) continue;
        Poses trial;
        for (size_t node = 0; node < poses.size(); ++node)
          trial.push_back(moved(poses[node], step.segment<6>(static_cast<Eigen::Index>(6 * node))));
        const double after = cost_of(edges, trial, is_huber);
        if (!(after < cost)) continue;
        gain = (cost - after) / cost;
        cost = after;
        poses = std::move(trial);
        damping /= 1000;
      }
    }
  }
}

}  // namespace revisit::cli
