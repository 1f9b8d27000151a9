#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/datasets/pose.h"
#include "revisit/evaluation/listed_pairs.h"
#include "revisit/recognition/exclusion.h"

namespace revisit::pipeline {

/// How far apart two places are. Camera axes of KITTI: x right, y down, z forward [m].
enum class Distance {
  kXz,     // horizontal: sqrt(dx^2 + dz^2)
  k3d,     // Euclidean
  kBox,    // max(|dx|, |dy|, |dz|): the paper's "all three coordinate differences below 3 m"
  kPlace,  // 0 between scans of one named place, else infinite; for sets without poses
  kPairs,  // none: truth is listed (Trajectory::listed)
};
/// "xz", "3d", "box", "place", "pairs"; throws UsageError for anything else.
Distance parse_distance(const std::string& text);
const char* name_of(Distance distance);

/// A match is right nearer than `radius` (strictly), wrong beyond `false_beyond`, else neither.
struct TrueMatchRule {
  Distance distance = Distance::kXz;
  double radius = 5;        // [m]
  double false_beyond = 0;  // [m]; 0, or less than the radius: what is not right is wrong
  bool is_true(double metres) const { return metres < radius; }
  bool is_false(double metres) const { return metres >= radius && metres > false_beyond; }
};

enum class Truth { kRight, kWrong, kNeither };

/// Where and when each scan of a data set was taken, in frame order.
struct Trajectory {
  std::vector<int> frames;                 // strictly increasing; gaps are legal
  std::vector<Eigen::Vector3d> positions;  // translation of T_world_cam [m]; empty: no ground truth
  std::vector<double> times;               // [s]; empty: unknown
  std::vector<std::string> places;         // names; empty: unknown
  std::optional<ListedPairs> listed;       // the truth then, whatever else is known
  int64_t n_poses = 0;  // of the whole drive, as in Dataset: what tells KITTI's 00 from others
  int64_t size() const { return static_cast<int64_t>(frames.size()); }
};

/// Throws InputError when the frames are not strictly increasing or a position is not finite.
Trajectory make_trajectory(const Dataset& dataset);
/// Frame i is pose i. `times`: none, or at least one a pose; else throws InputError.
Trajectory make_trajectory(const std::vector<Pose>& T_world_cam,
                           const std::vector<double>& times = {});

double distance_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Distance kind);
/// Of two scans, by row. Throws Error for kPairs.
double distance_between(const Trajectory& trajectory, int64_t a, int64_t b, Distance kind);
/// What it is to find scan `match` for scan `query`; by row.
Truth truth_of(const Trajectory& trajectory, const TrueMatchRule& rule, int64_t query,
               int64_t match);
/// Throws UsageError, naming `what` needs it, without positions (places, for kPlace).
void need_distances(const Trajectory& trajectory, Distance kind, const std::string& what);

/// WayDriven at each scan. Throws UsageError when `what` lacks its times or poses, InputError when
/// the times run backwards.
std::vector<double> way_along(const Trajectory& trajectory, Exclusion::Kind kind,
                              const char* what = "exclusion");

/// For each scan i, the candidates are scans [0, result[i]). Throws UsageError when the exclusion
/// lacks its times or poses, InputError when the times run backwards.
std::vector<int64_t> earlier_candidates(const Trajectory& trajectory, const Exclusion& exclusion);
/// The mirror image: scans [result[i], size) after scan i are candidates.
std::vector<int64_t> later_candidates(const Trajectory& trajectory, const Exclusion& exclusion);

/// Two scans of one place; indices into the trajectory (not frame numbers).
struct TruePair {
  int64_t query = 0, match = 0;  // match < query
  double distance = 0;           // [m], of the rule's kind
};

struct LoopTruth {
  int64_t n_queries = 0;        // scans with at least one candidate, the only ones that can match
  int64_t n_positives = 0;      // scans with at least one true match among their candidates
  std::vector<TruePair> pairs;  // by query, then by match
};

/// All true pairs of each scan with its earlier candidates.
///
///   auto poses = read_kitti_poses(find_kitti_poses(root, "00"));
///   auto apart = parse_exclusion("frames=50");
///   auto truth = find_loops(make_trajectory(poses), {Distance::kXz, 5}, apart);
///   truth.n_positives;  // 804 with the official poses (05: 503, 06: 270, 08: 345)
///
/// Both comparisons are strict. Throws UsageError for unknown distances or a radius not above 0.
LoopTruth find_loops(const Trajectory& trajectory, const TrueMatchRule& rule,
                     const Exclusion& exclusion);

}  // namespace revisit::pipeline
