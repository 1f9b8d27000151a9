#include "verification.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

constexpr double kConfirmed = 0.2;          // a confirmed loop may have less than the threshold
constexpr double kConfirmedInliers = 0.15;  // with fewer, half were off by more than 0.5 m

/// Transforms a registration of mounted points to the sensors' frames. `mount`: of the query.
void to_sensor_frames(const Eigen::Isometry3d& mount_of_place, const Eigen::Isometry3d& mount,
                      Registration& registered) {
  registered.T_place_query = mount_of_place.inverse() * registered.T_place_query * mount;
  // Motions of the query and of the mounted query are related by the adjoint Ad(mount).
  const Eigen::Matrix3d R = mount.rotation();
  Eigen::Matrix<double, 6, 6> adjoint = Eigen::Matrix<double, 6, 6>::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = R;
  for (int k = 0; k < 3; ++k) adjoint.block<3, 1>(0, 3 + k) = mount.translation().cross(R.col(k));
  registered.information = adjoint.transpose() * registered.information * adjoint;
}

}  // namespace

void Verification::arrive(const Description& scan, const SeenScan& seen, const ScanStamp& stamp,
                          const std::optional<Eigen::Isometry3d>& step) {
  std::optional<Eigen::Isometry3d> pose;
  if (stamp.pose && options_.odometry_gate) pose = *stamp.pose * map_.options().mount.inverse();
  const std::optional<int64_t> before = history_.reference();
  const bool needs_yaw = before && !pose && !step;
  history_.arrive(seen, stamp.frame, pose,
                  needs_yaw ? map_.compare(scan, *before).relative_yaw : std::nullopt, step);
}

double Verification::score_of(const Loop& loop, const DriveHistory& history, double scale,
                              double contradiction) {
  // Indoors, places that look alike differ by less: the similarity counts less.
  constexpr double kSimilarity = 0.1, kMargin = 0.05;
  const double margin = loop.similarity - loop.kth_similarity;
  return (kSimilarity * loop.similarity + kMargin * margin) * scale * scale + history.level(scale) -
         contradiction;
}

Verification::Candidate Verification::candidate_of(const Loop& loop, const SeenScan& query,
                                                   const DriveHistory& history) const {
  constexpr double kMinSimilarity = 0.25;
  Candidate candidate{.loop = loop};
  candidate.loop.score = unknown_score(loop, history);
  const std::string judged =
      loop.similarity < kMinSimilarity ? "similarity" : register_entry(query, history, candidate);
  candidate.rejection = acceptance_.decide(candidate.loop);
  if (!judged.empty()) candidate.rejection = judged;
  if (candidate.rejection == "score" && acceptance_.threshold())
    candidate.rejection = "contradicted";
  candidate.fits = candidate.rejection.empty();
  if (candidate.fits) {
    const std::string objection = history.objection(*candidate.place, candidate.T_place_query);
    if (!objection.empty()) reject(candidate, history, objection);
  }
  return candidate;
}

/// The score of loops that are not judged.
double Verification::unknown_score(const Loop& loop, const DriveHistory& history) {
  return score_of(loop, history, history.scale(), 0.5);
}

/// For a reason that the score does not know.
void Verification::reject(Candidate& candidate, const DriveHistory& history,
                          const std::string& why) const {
  candidate.loop.score = unknown_score(candidate.loop, history);
  acceptance_.decide(candidate.loop);  // sets the probability
  candidate.rejection = why;
}

/// Points of an entry; absent if it has none or corrupt ones.
std::optional<Verification::PreparedEntry> Verification::prepared_entry(int64_t id) const {
  constexpr size_t kMost = 8;  // half of all candidates are among the last 8
  const auto known = std::ranges::find(recent_, id, &PreparedEntry::id);
  if (known != recent_.end()) {
    std::rotate(recent_.begin(), known, known + 1);
    return recent_.front();
  }
  std::string bytes;
  std::pair<PointCloud, Eigen::Isometry3d> entry;  // with its mount
  try {
    map_.use_store([&](MapStore& store) { bytes = store.cloud(id); });
    if (bytes.empty()) return std::nullopt;
    entry = expand_cloud(bytes);
  } catch (const InputError& error) {
    if (corrupt_.insert(id).second) options_.warn(str("entry ", id, ": ", error.what()));
    return std::nullopt;
  }
  recent_.push_front({id, entry.second, {std::move(entry.first), options_.registration}});
  if (recent_.size() > kMost) recent_.pop_back();
  return recent_.front();
}

/// Returns the rejection, "" if only the score decides.
std::string Verification::register_entry(const SeenScan& query, const DriveHistory& history,
                                         Candidate& candidate) const {
  constexpr double kSlack = 5;  // what ICP adds to the search, and mounts [m]
  const Loop& loop = candidate.loop;
  const double reach = std::numbers::sqrt2 * options_.registration.search_radius + kSlack;
  if (history.is_of_drive(loop.index) &&
      history.is_out_of_reach(loop.index, loop.pose.has_value(), reach))
    return "odometry";
  const std::optional<PreparedEntry> stored = prepared_entry(loop.id);
  if (!stored) return "no points";
  const auto& [id, mount, place] = *stored;
  Registration found =
      register_scans(query.prepared(), place.prepared(), *loop.relative_yaw, options_.registration);
  candidate.T_place_query = found.T_place_query;
  to_sensor_frames(mount, map_.options().mount, found);
  candidate.registered = found;
  if (found.inlier_ratio < options_.registration.min_inlier_ratio) return "registration";
  std::optional<Eigen::Isometry3d> pose;
  if (loop.pose && options_.odometry_gate) pose = *loop.pose * mount.inverse();
  const bool drives = &history == &history_;
  candidate.place.emplace(
      CandidatePlace{loop.index, loop.drive, pose, place, pose && drives ? path_of(loop) : 0});
  return judge(query, history, candidate);
}

/// Path of its drive to an entry of another drive [m], by poses.
double Verification::path_of(const Loop& loop) const {
  if (history_.is_of_drive(loop.index)) return 0;
  std::map<int64_t, double>& paths = paths_[loop.drive];
  if (!paths.contains(loop.index)) {
    double path = 0;
    std::optional<Eigen::Vector3d> before;
    for (const auto& [frame, index] : map_.entries_of(loop.drive)) {
      const std::optional<Eigen::Isometry3d> pose = map_.entry(index).pose;
      if (pose && before) path += (pose->translation() - *before).norm();
      if (pose) before = pose->translation();
      paths[index] = path;
    }
  }
  return paths[loop.index];
}

/// Sets the score by free space, unless there are reasons against the loop. Returns as
/// register_entry().
std::string Verification::judge(const SeenScan& query, const DriveHistory& history,
                                Candidate& candidate) const {
  const CandidatePlace& place = *candidate.place;
  const Eigen::Isometry3d& T = candidate.T_place_query;
  if (history.is_of_drive(place.index) && history.is_refuted(place, T)) return "odometry";
  const double scale = (query.space().scale() + place.scan.space().scale()) / 2;
  const double score = score_of(candidate.loop, history, scale,
                                mutual_contradiction(query.space(), place.scan.space(), T));
  const bool is_hidden = history.is_hidden(query, place.scan);
  const double threshold = acceptance_.threshold().value_or(std::numeric_limits<double>::max());
  const bool is_free = candidate.registered->constraint < options_.registration.min_constraint;
  const bool is_confirmed = candidate.registered->inlier_ratio >= kConfirmedInliers &&
                            (is_hidden || is_free || score < threshold) &&
                            score >= threshold - kConfirmed * scale && history.confirms(place, T);
  if (is_free && !is_confirmed) {
    candidate.place.reset();
    return "registration";
  }
  if (is_hidden && !is_confirmed) return "hidden";
  candidate.loop.score = is_confirmed ? std::max(score, threshold) : score;
  return "";
}

/// Indices of the entries whose views look like the same place.
std::vector<int64_t> Verification::same_place(const Loop& loop) const {
  std::vector<int64_t> entries = map_.around(loop.index, !loop.ambiguous);
  if (loop.ambiguous) {  // only the part of the stretch around it: does the scan fit others, too?
    const auto at = std::ranges::lower_bound(entries, loop.index) - entries.begin();
    const auto half = std::max<std::ptrdiff_t>(1, std::ssize(entries) / 10);
    entries.erase(entries.begin() + std::min(std::ssize(entries), at + half + 1), entries.end());
    entries.erase(entries.begin(), entries.begin() + std::max<std::ptrdiff_t>(0, at - half));
  }
  entries.push_back(loop.index);
  return entries;
}

/// The most similar of the entries around the place of the loop that was accepted just before.
std::optional<Loop> Verification::followed(const Description& scan,
                                           const std::vector<int64_t>& excluded) const {
  constexpr int64_t kAround = 10;
  const std::optional<int64_t> last = history_.last_place();
  if (!last) return std::nullopt;
  std::pair<double, int64_t> best(-1, 0);  // similarity, index
  const int64_t end = std::min(map_.size(), *last + kAround + 1);
  for (int64_t index = std::max<int64_t>(0, *last - kAround); index < end; ++index)
    if (std::ranges::find(excluded, index) == excluded.end())
      best = std::max(best, {map_.similarity(scan, index), index});
  if (best.first < 0) return std::nullopt;
  Loop loop = map_.compare(scan, best.second);
  if (const auto yaw = history_.yaw_to(loop.index)) loop.relative_yaw = yaw;
  return loop;
}

/// Registers the most similar entries of several places, beginning with `first`. For a scan without
/// a drive one clear place does not suffice, because nothing else tells whether another is alike.
std::vector<Verification::Candidate> Verification::try_places(const Description& scan,
                                                              const SeenScan& seen,
                                                              const std::optional<Loop>& first,
                                                              std::vector<int64_t> excluded,
                                                              const DriveHistory& history) const {
  constexpr int kMost = 3, kMostAlone = 6;
  constexpr double kClear = 0.3;  // inlier ratio of an accepted loop that no other could beat
  const bool drives = &history == &history_;
  std::vector<Candidate> tried;
  for (std::optional<Loop> next = first; next; next = map_.query(scan, excluded)) {
    tried.push_back(candidate_of(*next, seen, history));
    const Candidate& candidate = tried.back();
    const bool is_clear = drives && candidate.rejection.empty() && !candidate.loop.ambiguous &&
                          candidate.registered->inlier_ratio >= kClear;
    if (is_clear || candidate.rejection == "similarity" ||
        std::ssize(tried) == (drives ? kMost : kMostAlone))
      break;
    std::ranges::copy(same_place(*next), std::back_inserter(excluded));
  }
  return tried;
}

bool Verification::is_better(const Candidate& one, const Candidate& other) {
  const auto rank = [](const Candidate& candidate) {
    return std::tuple(candidate.rejection.empty(), candidate.place.has_value(),
                      candidate.rejection != "similarity", candidate.loop.score);
  };
  return rank(one) > rank(other);
}

/// The scan fits another part of the map as well.
bool Verification::is_ambiguous(const Candidate& candidate,
                                const std::vector<Candidate>& tried) const {
  const double least = *acceptance_.threshold() - kConfirmed * history_.scale();
  return std::ranges::any_of(tried, [&](const Candidate& other) {
    return other.place && other.loop.score >= least &&
           !history_.are_one(*candidate.place, candidate.T_place_query, *other.place,
                             other.T_place_query);
  });
}

void Verification::verify(const Description& scan, const SeenScan& seen, Detection& found) {
  std::vector<Candidate> tried = try_places(scan, seen, found.loop, found.excluded, history_);
  if (std::ranges::none_of(tried, [](const auto& one) { return one.rejection.empty(); })) {
    std::vector<int64_t> without = found.excluded;
    for (const Candidate& one : tried) without.push_back(one.loop.index);
    if (const auto loop = followed(scan, without))
      tried.push_back(candidate_of(*loop, seen, history_));
  }
  Candidate best = *std::ranges::min_element(tried, is_better);
  if (best.rejection.empty() && best.loop.ambiguous && is_ambiguous(best, tried)) {
    reject(best, history_, "ambiguous");
    best.fits = false;
  }
  found.loop = best.loop;
  found.registered = best.registered;
  found.rejection = best.rejection;
  if (best.fits)
    found.questioned = history_.take_loop(*best.place, best.T_place_query, found.rejection.empty());
}

/// By the poses of the entries if they give the same pose, else by registration: the drive's motion
/// may be unknown between them.
bool Verification::are_one(const Candidate& one, const Candidate& other) const {
  constexpr double kNear = 1;  // [m]
  const auto &a = *one.place, &b = *other.place;
  const bool agree =
      a.pose && b.pose &&
      ((*a.pose * one.T_place_query).translation() - (*b.pose * other.T_place_query).translation())
              .norm() < kNear;
  return agree || alone_.are_one(a, one.T_place_query, b, other.T_place_query);
}

std::vector<Detection> Verification::locate(const Description& scan, const SeenScan& seen,
                                            const Loop& first) const {
  constexpr size_t kMost = 3;
  std::vector<Candidate> places = try_places(scan, seen, first, {}, alone_);
  std::ranges::stable_sort(places, is_better);
  const Candidate best = places.front();
  places.erase(places.begin());
  std::erase_if(places, [&](const Candidate& other) {
    return !other.place || (best.place && are_one(best, other));
  });
  const auto is_accepted = [](const Candidate& one) { return one.rejection.empty(); };
  const bool fits_others = std::ranges::any_of(places, is_accepted);
  places.insert(places.begin(), best);
  if (is_accepted(best) && (fits_others || (best.loop.ambiguous && is_ambiguous(best, places))))
    for (Candidate& one : places)
      if (is_accepted(one)) reject(one, alone_, "ambiguous");
  places.resize(std::min(places.size(), is_accepted(places.front()) ? 1 : kMost));
  std::vector<Detection> result;
  for (const Candidate& one : places)
    result.push_back({.loop = one.loop,
                      .registered = one.registered,
                      .accepted = is_accepted(one),
                      .rejection = one.rejection});
  return result;
}

}  // namespace revisit
