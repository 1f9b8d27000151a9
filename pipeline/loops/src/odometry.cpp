#include "odometry.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace revisit {

double heading_of(const Eigen::Isometry3d& T) {
  return std::atan2(T(1, 0), T(0, 0));
}

const PreparedScan& SeenScan::prepared() const {
  if (!parts_->prepared) parts_->prepared.emplace(parts_->cloud, parts_->options);
  return *parts_->prepared;
}

const FreeSpace& SeenScan::space() const {
  if (!parts_->space) parts_->space.emplace(parts_->cloud, prepared(), parts_->options);
  return *parts_->space;
}

void Odometry::arrive(const SeenScan& scan, int64_t frame,
                      const std::optional<Eigen::Isometry3d>& given,
                      std::optional<double> relative_yaw,
                      const std::optional<Eigen::Isometry3d>& step) {
  before_ = here_;
  here_ = {.frame = frame, .given = given, .stretch = here_.stretch};
  if (!reference_) return;
  const Eigen::Isometry3d motion = motion_of(scan, relative_yaw, step);
  here_.pose = reference_->at.pose * motion;
  here_.pose.linear() = Eigen::Quaterniond(here_.pose.linear()).normalized().toRotationMatrix();
  here_.path = reference_->at.path + motion.translation().norm();
  step_ = before_.pose.inverse() * here_.pose;
}

void Odometry::refer(int64_t index, const SeenScan& scan) {
  if (!reference_ || is_moving()) reference_.emplace(Reference{index, here_, scan});
}

/// Rings may take a corridor for itself turned around, and registration one bay for the next.
/// Results that differ from the motion before are therefore compared with others.
Eigen::Isometry3d Odometry::motion_of(const SeenScan& scan, std::optional<double> relative_yaw,
                                      const std::optional<Eigen::Isometry3d>& step) {
  const bool was_lost = std::exchange(is_lost_, false);
  is_known_ = true;
  if (here_.given && reference_->at.given) return reference_->at.given->inverse() * *here_.given;
  const Eigen::Isometry3d before = reference_->at.pose.inverse() * before_.pose;
  if (step) return before * *step;
  const Eigen::Isometry3d expected = before * step_.value_or(Eigen::Isometry3d::Identity());
  constexpr double kTurn = 30 * std::numbers::pi / 180;  // since the scan before
  constexpr double kShift = 1;                           // from the expected position [m]
  constexpr double kPoor = 0.6;                          // of the usual inlier ratio
  constexpr double kFree = 0.01;                         // constraint of motions that may slide
  constexpr double kWrong = 0.25;  // contradiction; of correct motions at most 0.2, else over 0.33
  const auto registered = [&](double yaw, double radius) {
    RegistrationOptions options = options_;
    options.search_radius = std::min(radius, options_.search_radius);
    return register_scans(scan.prepared(), reference_->scan.prepared(), yaw, options);
  };
  const auto contradiction_of = [&](const Registration& one) {
    return mutual_contradiction(scan.space(), reference_->scan.space(), one.T_place_query);
  };
  const double start = relative_yaw.value_or(heading_of(expected));
  const double moved = step_ ? step_->translation().norm() : 0;
  const double usual = inlier_ratios_.empty() ? 0 : median(inlier_ratios_);
  Registration found = registered(start, options_.search_radius);
  const auto compare = [&](const Registration& other) {
    if (other.inlier_ratio - contradiction_of(other) > found.inlier_ratio - contradiction_of(found))
      found = other;
  };
  const double turn = std::remainder(start - heading_of(before), 2 * std::numbers::pi);
  const double shift = (found.T_place_query.translation() - expected.translation()).norm();
  if (std::abs(turn) > kTurn || shift > kShift || found.inlier_ratio < kPoor * usual)
    compare(registered(heading_of(before), before.translation().norm() + moved + kShift));
  for (int turned = 1; turned < 8 && !was_lost && found.inlier_ratio < kPoor * usual; ++turned)
    compare(registered(heading_of(before) + turned * std::numbers::pi / 4, options_.search_radius));
  is_lost_ = found.inlier_ratio < kMinInlierRatio;
  is_known_ = !is_lost_ && contradiction_of(found) <= kWrong;
  if (!is_known_ || found.constraint < kFree) ++here_.stretch;
  if (!is_lost_) push_recent(inlier_ratios_, found.inlier_ratio, kRecent);
  return is_lost_ ? before : found.T_place_query;
}

bool Odometry::is_moving() const {
  constexpr double kHalt = 0.5;  // least distance of references [m]
  return is_lost_ || here_.path - reference_->at.path >= kHalt;
}

}  // namespace revisit
