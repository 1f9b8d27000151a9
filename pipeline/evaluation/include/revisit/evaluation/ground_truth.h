#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "revisit/datasets/dataset.h"
#include "revisit/evaluation/ground_truth.h"
#include "revisit/recognition/match.h"

namespace revisit {

/// Distance of two scans, by their positions or by other ground truth.
enum class Distance {
  kXy,     ///< horizontal in a world with z up: sqrt(dx^2 + dy^2)
  kXz,     ///< horizontal in KITTI's world, with y down
  k3d,     ///< sqrt(dx^2 + dy^2 + dz^2)
  kBox,    ///< max(|dx|, |dy|, |dz|): the paper's "all three coordinate differences below 3 m"
  kPlace,  ///< 0 between scans of the same named place, else infinite; for data sets without poses
  kPairs,  ///< none: ground truth is a list of pairs (Trajectory::listed)
};
/// "xy", "xz", "3d", "box", "place", "pairs"; throws UsageError for anything else.
Distance parse_distance(const std::string& text);
const char* name_of(Distance distance);  ///< inverse of parse_distance()

/// A match is correct if its distance is below `radius`, incorrect beyond `negative_radius`, else
/// neither.
struct MatchRule {
  Distance distance = Distance::kXy;  ///< which distance `radius` limits
  double radius = 5;                  ///< [m]
  /// [m]; 0 or below the radius: matches that are not correct are incorrect.
  double negative_radius = 0;
  bool is_correct(double meters) const { return meters < radius; }  ///< nearer than the radius
  /// Neither correct nor ignored.
  bool is_incorrect(double meters) const { return meters >= radius && meters > negative_radius; }
};

/// Label of a pair of scans by a MatchRule or a list.
enum class PairLabel { kCorrect, kIncorrect, kIgnored };

/// Ground truth as a list of pairs, for recordings without poses. A pair is symmetric, but only its
/// query is queried.
struct ListedPairs {
  using Places = std::map<int, std::set<int>>;  ///< frame of a query -> frames of its places
  Places correct;                               ///< empty set: the query is known to have no place
  Places ignored;                               ///< neither correct nor incorrect
  bool complete = false;  ///< true: unlisted queries have no place; false: unknown

  /// The places of the query are known.
  bool knows(int query) const { return complete || correct.contains(query); }
  std::string text() const;  ///< all frames; equal lists have equal texts
};

/// Scans of a data set, in frame order.
struct Trajectory {
  std::vector<int> frames;                 ///< strictly increasing; gaps are legal
  std::vector<Eigen::Vector3d> positions;  ///< of the poses [m]; empty: unknown
  Distance horizontal = Distance::kXy;     ///< of the positions' world
  std::vector<double> times;               ///< [s]; empty: unknown
  std::vector<std::string> places;         ///< empty: unknown
  std::optional<ListedPairs> listed;       ///< replaces all other ground truth
  int64_t n_poses = 0;  ///< of the complete drive, as in Dataset; identifies KITTI's sequences
  /// Number of scans.
  int64_t size() const { return static_cast<int64_t>(frames.size()); }
};

/// Throws InputError if the frames are not strictly increasing or a position is not finite.
Trajectory make_trajectory(const Dataset& dataset);
/// kXz or kXy, by the axes of the poses' world.
Distance horizontal_distance(const Dataset& dataset);

/// [m]; throws Error for kPlace and kPairs, which need more than positions.
double distance_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Distance kind);
/// `a` and `b` are rows. Throws Error for kPairs.
double distance_between(const Trajectory& trajectory, int64_t a, int64_t b, Distance kind);
/// `query` and `match` are rows.
PairLabel pair_label(const Trajectory& trajectory, const MatchRule& rule, int64_t query,
                     int64_t match);
/// Throws UsageError, mentioning `what`, without positions (for kPlace: place names).
void need_distances(const Trajectory& trajectory, Distance kind, const std::string& what);

/// ExclusionCounter at each scan. Throws UsageError if times or poses that `what` needs are
/// missing, and InputError if the times decrease.
std::vector<double> distance_along(const Trajectory& trajectory, Exclusion::Kind kind,
                                   const char* what = "exclusion");

/// Candidates of scan i are scans [0, result[i]). Throws as distance_along().
std::vector<int64_t> earlier_candidates(const Trajectory& trajectory, const Exclusion& exclusion);
/// Candidates of scan i among later scans: [result[i], size).
std::vector<int64_t> later_candidates(const Trajectory& trajectory, const Exclusion& exclusion);

/// Rows of all correct pairs of a scan, first, with its earlier candidates; by query, then by
/// match.
///
///   find_loops(make_trajectory(dataset), {Distance::kXz, 5}, parse_exclusion("frames=50"));
///
/// Both comparisons are strict. Throws UsageError for missing distances or a radius <= 0.
std::vector<std::pair<int64_t, int64_t>> find_loops(const Trajectory& trajectory,
                                                    const MatchRule& rule,
                                                    const Exclusion& exclusion);

/// Reads a table with a query and a place per line, in the first two columns or in those that a
/// header line names `query` and `place` (or `match`, as written by
/// `revisit eval --ground-truth`). Commas,
/// semicolons, tabs or blanks separate columns; # begins a comment. A scan is given by its frame or
/// its file name, with or without extension; in a data set of several folders with the folder:
/// "first/000032". A query without a place has none. Frames of the same folder within `near` frames
/// of a place count as places, too.
/// Throws InputError with file:line, also for a frame that the data set does not contain and for an
/// ambiguous name.
ListedPairs::Places read_pairs(const std::filesystem::path& file, const Dataset& dataset,
                               int near = 0);

}  // namespace revisit
