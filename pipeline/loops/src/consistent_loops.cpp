// Loops of a drive must agree with its poses, and with one another.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "drive_history.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {

std::optional<OdometryGate> parse_odometry_gate(const std::string& text) {
  if (text == "none") return std::nullopt;
  OdometryGate gate;
  std::string_view rest = text;
  bool valid = true;
  for (double* value : {&gate.base, &gate.rate, &gate.height}) {
    const size_t comma = std::min(rest.find(','), rest.size());
    const std::optional<double> number = finite_number(rest.substr(0, comma));
    valid = valid && number && *number >= 0 && (comma < rest.size()) == (value != &gate.height);
    *value = number.value_or(0);
    rest.remove_prefix(std::min(comma + 1, rest.size()));
  }
  if (!valid)
    throw UsageError("odometry gate: expected BASE,RATE,HEIGHT (at least 0) or none, found '", text,
                     "'");
  return gate;
}

bool DriveHistory::is_refuted(const CandidatePlace& place,
                              const Eigen::Isometry3d& T_place_scan) const {
  constexpr double kDegree = std::numbers::pi / 180, kTilt = 2.5;  // [degrees]
  const auto before = entries_.find(place.index);
  if (!place.pose || !here_.given)
    return before != entries_.end() &&
           is_refuted_by_motion(
               before->second,
               (before->second.pose * T_place_scan).translation() - here_.pose.translation(), 0);
  Eigen::Isometry3d expected = *here_.given;  // in the world of the place
  double path = here_.path;
  if (before != entries_.end()) {
    path -= before->second.path;
  } else {
    const auto related = related_.find(place.drive);
    if (related == related_.end()) return false;
    const FittingLoop& loop = related->second.loop;
    expected = *loop.pose * loop.T_place_scan * loop.at.given->inverse() * expected;
    path += std::abs(place.path - loop.path) - loop.at.path;
  }
  const Eigen::Isometry3d by_loop = *place.pose * T_place_scan;
  const auto up = [](const Eigen::Isometry3d& pose) -> Eigen::Vector3d {
    return pose.linear().col(2).normalized();
  };
  // A ramp may look like a level floor. Planar poses know no tilt, so theirs refutes nothing.
  const double least = std::cos(std::min(180., kTilt + gate_.rate / 20 * path) * kDegree);
  const bool is_tilted = before != entries_.end() && up(expected).dot(up(*place.pose)) < least &&
                         up(expected).dot(up(by_loop)) < least;
  return is_tilted || is_beyond(by_loop.translation() - expected.translation(),
                                up(*place.pose) + up(expected), path, 0);
}

bool DriveHistory::is_out_of_reach(int64_t index, bool by_poses, double reach) const {
  const Position& place = entries_.at(index);
  if (!by_poses || !place.given || !here_.given)
    return is_refuted_by_motion(place, place.pose.translation() - here_.pose.translation(), reach);
  return is_beyond(place.given->translation() - here_.given->translation(),
                   place.given->linear().col(2) + here_.given->linear().col(2),
                   here_.path - place.path, reach);
}

/// `up`: of any length. Worlds have any axes; the sensor's tilt is small.
bool DriveHistory::is_beyond(const Eigen::Vector3d& apart, const Eigen::Vector3d& up, double path,
                             double reach) const {
  const double height = apart.dot(up.normalized());
  return (apart - height * up.normalized()).norm() > gate_.base + gate_.rate * path + reach ||
         std::abs(height) > gate_.height + gate_.rate / 20 * path + reach;
}

/// By consecutive registrations. Their drift was at most 6 % of the path, in height 7 %.
bool DriveHistory::is_refuted_by_motion(const Position& place, const Eigen::Vector3d& apart,
                                        double reach) const {
  constexpr double kWider = 2;  // than the limits for odometry at first
  if (place.stretch != here_.stretch) return false;
  const double drift = gate_.rate * (here_.path - place.path) + reach;
  return apart.head<2>().norm() > kWider * gate_.base + drift ||
         std::abs(apart.z()) > kWider * gate_.height + drift;
}

std::optional<bool> DriveHistory::agree(const FittingLoop& one, const FittingLoop& before) const {
  constexpr double kYaw = 5 * std::numbers::pi / 180;        // [rad]
  constexpr double kYawRate = 0.1 * std::numbers::pi / 180;  // [rad per m]
  const auto to = entries_.find(one.index), from = entries_.find(before.index);
  double path = std::abs(one.at.path - before.at.path);
  Eigen::Isometry3d T_place_before;
  if (one.at.stretch != before.at.stretch) return std::nullopt;
  if (one.index == before.index) {
    T_place_before.setIdentity();
  } else if (to != entries_.end() && from != entries_.end()) {
    if (to->second.stretch != from->second.stretch) return std::nullopt;
    T_place_before = to->second.pose.inverse() * from->second.pose;
    path += std::abs(to->second.path - from->second.path);
  } else if (one.drive == before.drive && one.pose && before.pose) {
    T_place_before = one.pose->inverse() * *before.pose;
    path += std::abs(one.path - before.path);
  } else {
    return std::nullopt;
  }
  const Eigen::Isometry3d error = one.T_place_scan.inverse() * T_place_before *
                                  before.T_place_scan * before.at.pose.inverse() * one.at.pose;
  return error.translation().head<2>().norm() < (gate_.base + gate_.rate * path) / 2 &&
         std::abs(heading_of(error)) < kYaw + kYawRate * path;
}

std::string DriveHistory::objection(const CandidatePlace& place,
                                    const Eigen::Isometry3d& T_place_scan) const {
  if (is_refuted(place, T_place_scan)) return "odometry";
  FittingLoop loop = fitting(place, T_place_scan);
  for (const FittingLoop& before : fitting_)
    if (const auto agrees = agree(loop, before)) loop.count(*agrees);
  return loop.is_outvoted() ? "inconsistent" : "";
}

std::vector<int64_t> DriveHistory::take_loop(const CandidatePlace& place,
                                             const Eigen::Isometry3d& T_place_scan, bool accepted) {
  constexpr size_t kMostAccepted = 5;  // loops that may confirm another
  constexpr double kHalted = 0.5;      // agreeing loops on less are one [m]
  std::vector<int64_t> questioned;
  if (accepted) {
    accepted_.push_back({place, T_place_scan, here_});
    if (accepted_.size() > kMostAccepted) accepted_.pop_front();
  }
  FittingLoop loop = fitting(place, T_place_scan);
  if (accepted) loop.frames.push_back(here_.frame);
  if (!fitting_.empty() && std::abs(here_.path - fitting_.back().at.path) < kHalted &&
      agree(loop, fitting_.back()).value_or(false)) {
    std::ranges::copy(loop.frames, std::back_inserter(fitting_.back().frames));
    if (const auto related = related_.find(place.drive); related != related_.end())
      std::ranges::copy(loop.frames, std::back_inserter(related->second.frames));
    return questioned;
  }
  for (FittingLoop& before : fitting_) {
    const auto agrees = agree(loop, before);
    if (!agrees) continue;
    loop.count(*agrees);
    before.count(*agrees);
    if (!before.is_outvoted()) continue;
    std::erase_if(related_,
                  [&](const auto& one) { return one.second.loop.at.frame == before.at.frame; });
    for (auto& [drive, relation] : related_) std::erase(relation.frames, before.at.frame);
    std::ranges::move(std::exchange(before.frames, {}), std::back_inserter(questioned));
  }
  if (!is_of_drive(place.index) && place.pose && here_.given)
    std::ranges::copy(relate(loop, accepted), std::back_inserter(questioned));
  fitting_.push_back(std::move(loop));
  return questioned;
}

/// A stretch that looks like another may have related the drives. Loops that the relation refutes
/// overrule it when more of them agree than it has accepted. Returns the frames of those.
std::vector<int64_t> DriveHistory::relate(const FittingLoop& loop, bool accepted) {
  const bool agrees = loop.agreeing > loop.contradicting;
  auto related = related_.find(loop.drive);
  if (related == related_.end()) {
    if (!accepted || !agrees) return {};
    related = related_.emplace(loop.drive, Relation{loop, loop}).first;
    for (const FittingLoop& before : fitting_)
      if (before.drive == loop.drive && agree(loop, before).value_or(false))
        std::ranges::copy(before.frames, std::back_inserter(related->second.frames));
  }
  Relation& relation = related->second;
  if (accepted) relation.frames.push_back(loop.at.frame);
  if (!agrees) return {};
  if (accepted) {
    relation.loop = loop;
    ++relation.n_accepted;
    relation.n_refuted = 0;
    return {};
  }
  if (!agree(loop, std::exchange(relation.refuted, loop)).value_or(false)) relation.n_refuted = 0;
  if (++relation.n_refuted <= relation.n_accepted) return {};
  std::vector<int64_t> frames = std::move(relation.frames);
  related_.erase(related);
  return frames;
}

}  // namespace revisit
