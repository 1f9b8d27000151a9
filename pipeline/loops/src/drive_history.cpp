#include "drive_history.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

namespace revisit {
namespace {

// Constants were chosen together, on simulated offices and streets, a walk, NCLT and Riverside.
constexpr double kWindow = 10;    // path on which an accepted loop confirms another [m]
constexpr double kCompared = 30;  // path on which loops are compared [m]
constexpr int64_t kSample = 4;    // one moving scan in 4 tells what is usual

}  // namespace

void DriveHistory::arrive(const SeenScan& scan, int64_t frame,
                          const std::optional<Eigen::Isometry3d>& given,
                          std::optional<double> relative_yaw,
                          const std::optional<Eigen::Isometry3d>& step) {
  Odometry::arrive(scan, frame, given, relative_yaw, step);
  if (is_lost()) accepted_.clear();
  while (!fitting_.empty() && here_.path - fitting_.front().at.path > kCompared)
    fitting_.pop_front();
  if ((!reference_ || is_moving()) && moved_++ % kSample == 0) sample(scan);
}

void DriveHistory::sample(const SeenScan& scan) {
  constexpr double kPrior = 5;
  constexpr int64_t kMinUpright = 200;
  scale_ = scan.space().scale();
  push_recent(upright_, scan.space().upright(), kRecent);
  if (!reference_ || here_.stretch != reference_->at.stretch) return;  // the motion is unknown
  const Contradiction found = contradiction(scan.space(), reference_->scan.space(),
                                            reference_->at.pose.inverse() * here_.pose);
  const auto upright = static_cast<double>(std::max(scan.space().upright(), kMinUpright));
  if (static_cast<double>(found.confirmed) >= kMinInlierRatio * upright)
    push_recent(contradictions_, found.fraction(kPrior), kRecent);
}

void DriveHistory::add(int64_t index, const SeenScan& scan) {
  entries_[index] = here_;
  refer(index, scan);
}

double DriveHistory::level(double scale) const {
  constexpr double kUnknown = 0.03;
  constexpr double kMost = 0.08;  // more means that registrations of consecutive scans fail
  return contradictions_.size() < 5 ? kUnknown * scale * scale
                                    : std::min(kMost, median(contradictions_));
}

bool DriveHistory::is_hidden(const SeenScan& scan, const SeenScan& place) const {
  if (upright_.empty()) return false;
  // A few points fit everywhere, sooner in a small scene.
  const double scale = (scan.space().scale() + place.space().scale()) / 2;
  const double few = (0.25 + 0.6 * (1 - scale)) * median(upright_);
  return static_cast<double>(std::min(scan.space().upright(), place.space().upright())) < few;
}

/// T_to_from by motions or poses of one drive, else by registration.
std::optional<Eigen::Isometry3d> DriveHistory::between(const CandidatePlace& to,
                                                       const CandidatePlace& from,
                                                       const Eigen::Isometry3d& expected) const {
  constexpr double kFarthest = 20;  // [m]
  if (to.index == from.index) return Eigen::Isometry3d::Identity();
  const auto T_to = entries_.find(to.index), T_from = entries_.find(from.index);
  if (T_to != entries_.end() && T_from != entries_.end())
    return T_to->second.pose.inverse() * T_from->second.pose;
  if (to.drive == from.drive && to.pose && from.pose) return to.pose->inverse() * *from.pose;
  RegistrationOptions options = options_;  // the scan may be far from both
  options.search_radius = std::max(options.search_radius, expected.translation().norm() + 1);
  if (options.search_radius > kFarthest) return std::nullopt;
  const Registration found =
      register_scans(from.scan.prepared(), to.scan.prepared(), heading_of(expected), options);
  if (!found.fits) return std::nullopt;
  constexpr double kUsual = 2;  // times the level
  constexpr int64_t kNear = 10;
  const bool are_near = to.drive == from.drive && std::abs(to.index - from.index) <= kNear;
  if (!are_near && mutual_contradiction(from.scan.space(), to.scan.space(), found.T_place_query) >
                       kUsual * level((from.scan.space().scale() + to.scan.space().scale()) / 2))
    return std::nullopt;
  return found.T_place_query;
}

std::optional<int64_t> DriveHistory::last_place() const {
  if (accepted_.empty() || here_.path - accepted_.back().at.path > kWindow) return std::nullopt;
  return accepted_.back().place.index;
}

std::optional<double> DriveHistory::yaw_to(int64_t index) const {
  const AcceptedLoop& last = accepted_.back();
  const auto place = entries_.find(last.place.index), entry = entries_.find(index);
  if (place == entries_.end() || entry == entries_.end()) return std::nullopt;
  return heading_of(entry->second.pose.inverse() * place->second.pose * last.T_place_scan *
                    last.at.pose.inverse() * here_.pose);
}

bool DriveHistory::are_one(const CandidatePlace& place, const Eigen::Isometry3d& T_place_scan,
                           const CandidatePlace& other, const Eigen::Isometry3d& T_other_scan,
                           double path, bool whole) const {
  constexpr double kBase = 1, kRate = 0.05;  // [m], [m per m]
  constexpr double kTurn = 5 * std::numbers::pi / 180;
  const auto T_place_other = between(place, other, T_place_scan * T_other_scan.inverse());
  if (!T_place_other) return false;
  const Eigen::Isometry3d error = T_place_scan.inverse() * *T_place_other * T_other_scan;
  const double turn = whole ? Eigen::AngleAxisd(error.linear()).angle() : heading_of(error);
  return error.translation().head<2>().norm() < kBase + kRate * path && std::abs(turn) < kTurn;
}

bool DriveHistory::confirms(const CandidatePlace& place,
                            const Eigen::Isometry3d& T_place_scan) const {
  return std::ranges::any_of(accepted_, [&](const AcceptedLoop& earlier) {
    const double path = here_.path - earlier.at.path;
    const Eigen::Isometry3d motion = earlier.at.pose.inverse() * here_.pose;
    return path <= kWindow &&
           are_one(place, T_place_scan, earlier.place, earlier.T_place_scan * motion, path, true);
  });
}

}  // namespace revisit
