#include "revisit/evaluation/ground_truth.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "revisit/base/error.h"

namespace revisit {
namespace {

constexpr const char* kDistances[] = {"xz", "3d", "box", "place", "pairs"};

}  // namespace

Distance parse_distance(const std::string& text) {
  const auto* const found = std::ranges::find(kDistances, text);
  if (found == std::end(kDistances))
    throw UsageError("distance: expected xz, 3d, box or place, found '", text, "'");
  return static_cast<Distance>(found - kDistances);
}

const char* name_of(Distance distance) {
  return kDistances[static_cast<size_t>(distance)];
}

Trajectory make_trajectory(const Dataset& dataset) {
  Trajectory trajectory;
  trajectory.n_poses = dataset.n_poses;
  const bool has_poses = dataset.has_poses();
  bool has_times = !dataset.scans.empty();
  for (const ScanRef& scan : dataset.scans) has_times &= scan.time.has_value();
  for (const ScanRef& scan : dataset.scans) {
    if (!trajectory.frames.empty() && scan.frame <= trajectory.frames.back())
      throw InputError(scan.file.string(), ": frame ", scan.frame, " comes after frame ",
                       trajectory.frames.back(), "; frames must increase");
    trajectory.frames.push_back(scan.frame);
    if (has_times) trajectory.times.push_back(*scan.time);
    if (dataset.has_places()) trajectory.places.push_back(scan.place);
    if (!has_poses) continue;
    trajectory.positions.emplace_back(scan.pose->translation());
    if (!trajectory.positions.back().allFinite())
      throw InputError(scan.file.string(), ": the pose of frame ", scan.frame, " is not finite");
  }
  return trajectory;
}

Trajectory make_trajectory(const std::vector<Pose>& T_world_cam, const std::vector<double>& times) {
  if (!times.empty() && times.size() < T_world_cam.size())
    throw InputError("fewer time stamps (", times.size(), ") than poses (", T_world_cam.size(),
                     ")");
  Trajectory trajectory;
  trajectory.n_poses = static_cast<int64_t>(T_world_cam.size());
  trajectory.frames.resize(T_world_cam.size());
  std::iota(trajectory.frames.begin(), trajectory.frames.end(), 0);
  for (size_t i = 0; i < T_world_cam.size(); ++i) {
    trajectory.positions.emplace_back(T_world_cam[i].translation());
    if (!trajectory.positions.back().allFinite())
      throw InputError("the pose of frame ", i, " is not finite");
    if (!times.empty()) trajectory.times.push_back(times[i]);
  }
  return trajectory;
}

double distance_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Distance kind) {
  const Eigen::Vector3d difference = a - b;
  switch (kind) {
    case Distance::kXz:
      return std::sqrt(difference.x() * difference.x() + difference.z() * difference.z());
    case Distance::k3d:
      return difference.norm();
    case Distance::kBox:
      return difference.cwiseAbs().maxCoeff();
    case Distance::kPlace:
    case Distance::kPairs:
      break;
  }
  throw Error("the distance ", name_of(kind), " is not one of positions");
}

double distance_between(const Trajectory& trajectory, int64_t a, int64_t b, Distance kind) {
  if (kind == Distance::kPlace)
    return trajectory.places.at(a) == trajectory.places.at(b)
               ? 0
               : std::numeric_limits<double>::infinity();
  return distance_between(trajectory.positions.at(a), trajectory.positions.at(b), kind);
}

std::vector<double> distance_along(const Trajectory& trajectory, Exclusion::Kind kind,
                                   const char* what) {
  const bool in_seconds = kind == Exclusion::Kind::kSeconds;
  if (in_seconds && trajectory.times.empty())
    throw UsageError(what,
                     " in seconds: the data set has no time stamps (times.txt); use frames=N");
  if (kind == Exclusion::Kind::kMeters && trajectory.positions.empty())
    throw UsageError(what, " in meters: the data set has no poses; use frames=N");
  std::vector<double> along;
  ExclusionCounter driven(kind);
  for (size_t i = 0; i < trajectory.frames.size(); ++i) {
    std::optional<double> time;
    std::optional<Eigen::Vector3d> position;
    if (!trajectory.times.empty()) time = trajectory.times[i];
    if (!trajectory.positions.empty()) position = trajectory.positions[i];
    along.push_back(driven.at(trajectory.frames[i], time, position));
    if (in_seconds && i > 0 && !(along[i] >= along[i - 1]))
      throw InputError("the time stamps decrease at frame ", trajectory.frames[i], ": ",
                       along[i - 1], " s, then ", along[i], " s");
  }
  return along;
}

PairLabel pair_label(const Trajectory& trajectory, const TrueMatchRule& rule, int64_t query,
                     int64_t match) {
  if (rule.distance == Distance::kPairs) {
    const ListedPairs& listed = trajectory.listed.value();
    const int queried = trajectory.frames.at(query), found = trajectory.frames.at(match);
    const auto has = [](const ListedPairs::Places& places, int from, int to) {
      const auto of_query = places.find(from);
      return of_query != places.end() && of_query->second.contains(to);
    };
    const auto holds = [&](const ListedPairs::Places& places) {
      return has(places, queried, found) || has(places, found, queried);
    };
    if (holds(listed.correct)) return PairLabel::kCorrect;
    return holds(listed.ignored) || !listed.knows(queried) ? PairLabel::kIgnored
                                                           : PairLabel::kIncorrect;
  }
  const double meters = distance_between(trajectory, query, match, rule.distance);
  if (rule.is_true(meters)) return PairLabel::kCorrect;
  return rule.is_false(meters) ? PairLabel::kIncorrect : PairLabel::kIgnored;
}

void need_distances(const Trajectory& trajectory, Distance kind, const std::string& what) {
  if (kind == Distance::kPlace && trajectory.places.empty())
    throw UsageError(what, " needs named places; this data set has none");
  if (kind == Distance::kPairs) {
    if (!trajectory.listed) throw UsageError(what, " needs a list of pairs");
    return;
  }
  if (kind == Distance::kPlace || !trajectory.positions.empty()) return;
  if (trajectory.places.empty()) throw UsageError(what, " needs poses; this data set has none");
  throw UsageError(what,
                   " needs poses; this data set has none, but places: use the distance place");
}

std::vector<int64_t> earlier_candidates(const Trajectory& trajectory, const Exclusion& exclusion) {
  const std::vector<double> along = distance_along(trajectory, exclusion.kind);
  std::vector<int64_t> ends(along.size());
  int64_t end = 0;
  for (int64_t i = 0; i < trajectory.size(); ++i) {
    if (exclusion.kind == Exclusion::Kind::kNone) end = i;
    while (end < i && along[i] - along[end] > exclusion.amount) ++end;
    ends[i] = end;
  }
  return ends;
}

std::vector<int64_t> later_candidates(const Trajectory& trajectory, const Exclusion& exclusion) {
  const std::vector<double> along = distance_along(trajectory, exclusion.kind);
  std::vector<int64_t> begins(along.size());
  int64_t begin = trajectory.size();
  for (int64_t i = trajectory.size() - 1; i >= 0; --i) {
    if (exclusion.kind == Exclusion::Kind::kNone) begin = i + 1;
    while (begin > i + 1 && along[begin - 1] - along[i] > exclusion.amount) --begin;
    begins[i] = begin;
  }
  return begins;
}

LoopTruth find_loops(const Trajectory& trajectory, const TrueMatchRule& rule,
                     const Exclusion& exclusion) {
  need_distances(trajectory, rule.distance, "ground truth");
  if (!(rule.radius > 0) || !std::isfinite(rule.radius))
    throw UsageError("radius: expected a positive number of meters, found ", rule.radius);
  const std::vector<int64_t> ends = earlier_candidates(trajectory, exclusion);
  LoopTruth truth;
  for (int64_t i = 0; i < trajectory.size(); ++i) {
    const size_t before = truth.pairs.size();
    for (int64_t j = 0; j < ends[i]; ++j) {
      const double distance = distance_between(trajectory, i, j, rule.distance);
      if (rule.is_true(distance)) truth.pairs.push_back({i, j, distance});
    }
    truth.n_queries += ends[i] > 0;
    truth.n_positives += truth.pairs.size() > before;
  }
  return truth;
}

}  // namespace revisit
