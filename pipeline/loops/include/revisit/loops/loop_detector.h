#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "revisit/maps/map.h"
#include "revisit/recognition/match.h"
#include "revisit/registration/registration.h"

namespace revisit {

/// Identity of a scan in its drive.
struct ScanStamp {
  int64_t frame = 0;                      ///< ascends in a drive
  std::optional<double> time;             ///< [s]
  std::optional<Eigen::Isometry3d> pose;  ///< T_world_sensor
};

/// Entries of a drive that are temporal neighbors of its next scan and excluded from matching.
class RecentEntries {
 public:
  /// Begins a drive.
  explicit RecentEntries(const Exclusion& exclusion) : exclusion_(exclusion), driven_(exclusion) {}
  /// Indices of the entries excluded for this scan, whose motion is that of
  /// ExclusionCounter::at(). Throws UsageError if the exclusion needs a time that the scan lacks.
  std::span<const int64_t> at(const ScanStamp& scan,
                              const std::optional<double>& registered = std::nullopt);
  /// Adds the scan of the last at() as the entry at `index`.
  void add(int64_t index);

 private:
  Exclusion exclusion_;
  ExclusionCounter driven_;
  double along_ = 0;
  /// Index, and distance along the drive, in frames, seconds or meters.
  std::deque<std::pair<int64_t, double>> entries_;
  std::vector<int64_t> indices_;
};

/// Throws UsageError unless it is a value of LoopDetectorOptions::keyframes.
void check_keyframes(const std::string& text);

/// Limits of the difference between the pose of a scan and its pose by a loop. They grow with the
/// path from the place to the scan. In a drive, tilts that poses show may differ by 2.5 degrees.
struct OdometryGate {
  double base = 2;      ///< horizontal [m]
  double rate = 0.1;    ///< horizontal, per meter of path; height, tilt [deg]: a twentieth
  double height = 0.5;  ///< vertical [m]
};
/// "BASE,RATE,HEIGHT", or "none"; throws UsageError for anything else.
std::optional<OdometryGate> parse_odometry_gate(const std::string& text);

/// Settings of a LoopDetector.
struct LoopDetectorOptions {
  /// File or server's address of the map (open_map()), of ring descriptors; "": a temporary map.
  /// For other options of a map, pass a Map.
  std::filesystem::path map;
  std::string drive;    ///< recording in the map; drive_in_map() may add a number
  Exclusion exclusion;  ///< temporal neighbors, which are no matches
  /// Selects the scans that become map entries (all scans are queries): "all"; "meters=1", if the
  /// distance from the last keyframe, by the poses, is at least 1 m; "similarity=0.9", if the
  /// similarity to the last keyframe is below 0.9.
  std::string keyframes = "all";
  /// Registers the most similar entries and judges them by free space (verified_calibration()).
  /// Absent: enabled if the feature estimates the relative yaw and points are kept.
  std::optional<bool> verify;
  /// Minimum score() for acceptance. Absent: the lowest that reaches `target_precision`.
  std::optional<double> threshold;
  /// Fraction of accepted loops that are correct, by the calibration. Absent:
  /// default_target_precision().
  std::optional<double> target_precision;
  bool keep_clouds = true;  ///< stores points, to register later scans
  /// Poses of scans are odometry: they measure the motion, and loops beyond these limits are
  /// rejected. Between two drives the limits apply after two agreeing loops, which relate their
  /// worlds. Absent: consecutive scans are registered instead, as without poses. Poses then judge
  /// nothing, e.g. because they are ground truth, which must not help to find what it evaluates.
  std::optional<OdometryGate> odometry_gate = OdometryGate();
  /// Requires few inliers, because free space decides.
  RegistrationOptions registration{.min_inlier_ratio = 0.1};
  /// Gets messages about the map (Map::Map()), and about a calibration of it that is corrupt or for
  /// another score, and ignored. Absent: standard error.
  MapStore::Warn warn;
};

/// Result for one scan.
struct Detection {
  std::string error;             ///< empty: the scan was described
  std::optional<int64_t> index;  ///< index of the entry; absent: no keyframe
  /// The most similar entry, or the better fitting one of three. If loops are registered, its score
  /// is Score::kVerified, with the probability for this score.
  std::optional<Loop> loop;
  /// Registration of `loop`, if it is similar enough and in reach of the motion. If it does not
  /// fit, but is accepted, another loop confirms it: its information is small along a corridor.
  std::optional<Registration> registered;
  /// `loop` reaches the threshold, is not ambiguous and, if loops are registered, fits or is
  /// confirmed by a loop accepted on the last 10 m.
  bool accepted = false;
  /// "": no loop, or accepted; "score": below the threshold, or too few candidates, not registered.
  /// If loops are registered: "similarity": too low to register; "no points"; "registration": it
  /// does not fit; "contradicted": by free space; "hidden": something near hides a scan;
  /// "odometry": the poses or the registered motion exclude it; "inconsistent": other loops of the
  /// last 30 m do. "ambiguous" in any case.
  std::string rejection;
  /// Frames of earlier scans whose accepted loops are called in question: `loop` and others
  /// contradict them. `loop` need not be accepted. Remove them from the pose graph.
  std::vector<int64_t> questioned;
  std::vector<int64_t> excluded;  ///< indices of temporal neighbors
};

/// Front end of loop closure: takes the scans of one drive in order and finds revisits. Each scan
/// is described, compared with the entries that are not excluded, and added. With any exclusion, a
/// scan is not compared with the halt in which it was taken. During the warm-up only one scan of a
/// halt is added.
/// A recording that the map contains in part, by name and content, is resumed: its stored scans are
/// compared but not added again, and its later scans are never matches.
///
///   LoopDetector detector({.map = "site.map"});
///   const Detection found = detector.take({points.data(), n, sizeof(MyPoint)}, {.frame = 17});
///   if (found.accepted) close_loop(found.loop->id, found.registered->T_place_query);
class LoopDetector {
 public:
  /// Opens the map. Throws what Map::Map() throws, and UsageError for invalid options.
  explicit LoopDetector(const LoopDetectorOptions& options);
  /// `map` must outlive this object. Throws UsageError for invalid options, and if `verify` is true
  /// and the feature estimates no relative yaw.
  LoopDetector(Map& map, const LoopDetectorOptions& options);
  ~LoopDetector();
  /// Throws what Map::add() throws, and UsageError if its frame is not above that of the scan
  /// before or the exclusion needs a time that `scan` lacks. Local maps accumulate scans by their
  /// poses, or else by registration of consecutive scans.
  Detection take(const PointsView& points, const ScanStamp& scan);
  /// Where in the map a scan of unknown pose was taken: the best place and, if it is not accepted,
  /// up to two others. If two fit equally well, none is accepted ("ambiguous"). Nothing is added,
  /// and no scan before counts. A map of local maps needs the points of one, accumulated by the
  /// caller. At least one element, which has no loop if the map is empty.
  std::vector<Detection> locate(const PointsView& points);

  Map& map() const;                  ///< the map in use
  const std::string& drive() const;  ///< name of the recording in the map
  /// True if accepted loops have a pose (Detection::registered).
  bool verifies() const;
  /// Score::kVerified, or MapOptions::score if loops are not registered.
  Score score() const;
  /// Threshold and calibration for this score; absent if no calibration reaches the precision.
  std::optional<double> threshold() const;
  /// That of the map, else verified_calibration() or, for loops that are not registered, that of
  /// the feature.
  std::optional<Calibration> calibration() const;
  /// Stores a calibration in the map, for detectors to be made and those of other processes. Throws
  /// UsageError for another k or score, or without blocks.
  void calibrate(const Calibration& calibration);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// True if `scan`, taken at `time` [s], is the entry at `index`, described again. With equal
/// nonzero times the scans may differ in deskewing.
bool is_same_scan(const Map& map, const Description& scan, std::optional<double> time,
                  int64_t index);

/// True if `frame` lies between those of the entries, or the gap is at most the length of the
/// drive. This separates folders named by time that were recorded on different days.
bool may_belong_to(const DriveEntries& entries, int64_t frame);

/// Name of a recording in the map: the first of "monday", "monday-2", ... that has no entries, or
/// whose entries belong to the recording (`is_it`); in a merged map also "MAP/monday". A new name
/// is reserved for the recording that begins with the scan `first`, so that no other process uses
/// it.
std::string drive_in_map(Map& map, const std::string& name, const PointsView& first,
                         const std::function<bool(const DriveEntries&)>& is_it);

/// 0.99 for Score::kVerified, else 0.95, because similarities alone cannot promise more: shipped
/// ring models reach 0.979.
double default_target_precision(Score score);

/// Default calibration of Score::kVerified for ring descriptors.
const Calibration& verified_calibration();

}  // namespace revisit
