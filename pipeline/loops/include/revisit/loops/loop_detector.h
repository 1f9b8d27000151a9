#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/match.h"
#include "revisit/registration/registration.h"

namespace revisit {

struct ScanStamp {
  int64_t frame = 0;
  std::optional<double> time;             // [s]
  std::optional<Eigen::Isometry3d> pose;  // T_world_sensor
};

/// Entries of a drive that are temporal neighbors of its next scan and excluded from matching.
class RecentEntries {
 public:
  explicit RecentEntries(const Exclusion& exclusion)
      : exclusion_(exclusion), driven_(exclusion.kind) {}
  /// Indices of the entries excluded for this scan. Throws UsageError if the exclusion needs a time
  /// or a pose that the scan lacks.
  std::span<const int64_t> at(const ScanStamp& scan);
  /// Adds the scan of the last at() as the entry at `index`.
  void add(int64_t index);

 private:
  Exclusion exclusion_;
  ExclusionCounter driven_;
  double along_ = 0;
  // Index, and distance along the drive, in frames, seconds or meters.
  std::deque<std::pair<int64_t, double>> entries_;
  std::vector<int64_t> indices_;
};

/// Throws UsageError unless it is a value of LoopDetectorOptions::keyframes.
void check_keyframes(const std::string& text);

struct LoopDetectorOptions {
  std::string drive;  // recording in the map; drive_in_map() may add a number
  Exclusion exclusion;
  /// Selects the scans that become map entries (all scans are queries): "all"; "meters=1", if the
  /// distance from the last keyframe, by the poses, is at least 1 m; "similarity=0.9", if the
  /// similarity to the last keyframe is below 0.9.
  std::string keyframes = "all";
  /// Registers the most similar entries and accepts loops by their fit as well
  /// (verified_calibration()). Absent: enabled if the feature estimates the relative yaw and points
  /// are kept. If false, PlaceRecognizer decides.
  std::optional<bool> verify;
  /// Minimum Score::kVerified for acceptance. Absent: the lowest score that reaches
  /// `target_precision`.
  std::optional<double> threshold;
  double target_precision = 0.99;  // of accepted registered loops
  // Stores points, to register later scans; without a map only if loops are registered.
  bool keep_clouds = true;
  /// Requires fewer inliers than registration alone, because the similarity counts, too.
  RegistrationOptions registration{.min_inlier_ratio = 0.25};
  /// Describes and registers the points of the last meters, accumulated by the scans' poses,
  /// instead of single scans [m]; 0: off. For sensors with a gap in azimuth or with few points.
  /// With a map it must equal RecognizerOptions::local_map.
  double local_map = 0;
};

struct Detection {
  std::string error;             // empty: the scan was described
  std::optional<int64_t> index;  // index of the entry; absent: no keyframe
  /// The most similar entry, or the better fitting one of two. If loops are registered, its score
  /// is Score::kVerified, with the probability for this score.
  std::optional<Loop> loop;
  /// Registration of `loop`, if it is similar enough; accepted if and only if the loop is.
  std::optional<Registration> registered;
  /// "": none; "score": below the threshold, or too few candidates, not registered; "similarity":
  /// score above the threshold, but similarity too low to register; "ambiguous", "no points" or
  /// "registration".
  std::string rejection;
  std::vector<int64_t> excluded;  // indices of temporal neighbors
};

/// Front end of loop closure: takes the scans of one drive in order and finds revisits. Each scan
/// is described, compared with the entries that are not excluded, and added. With any exclusion, a
/// scan is not compared with the halt in which it was taken. During the warm-up only one scan of a
/// halt is added.
/// A recording that the map contains in part, by name and content, is resumed: its stored scans are
/// compared but not added again, and its later scans are never matches.
///
///   LoopDetector detector(recognizer, {.drive = "monday"});
///   const Detection found = detector.take({points.data(), n, sizeof(MyPoint)}, {.frame = 17});
///   if (found.loop && found.loop->accepted)
///     close_loop(found.loop->id, found.registered->T_place_query);
class LoopDetector {
 public:
  /// `recognizer` must outlive this object. Throws UsageError for invalid options, and if `verify`
  /// is true and the feature estimates no relative yaw.
  LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options);
  ~LoopDetector();
  /// Throws what PlaceRecognizer::add() throws, and UsageError if the exclusion needs a time or a
  /// pose that `scan` lacks. With local maps, a scan without a pose is not described.
  Detection take(const PointsView& points, const ScanStamp& scan);
  const std::string& drive() const;
  /// True if accepted loops have a pose (Detection::registered).
  bool verifies() const;
  /// Score::kVerified, or PlaceRecognizer::score() if loops are not registered.
  Score score() const;
  /// Threshold and calibration for this score; absent if no calibration reaches the precision.
  std::optional<double> threshold() const;
  std::optional<Calibration> calibration() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Default calibration of Score::kVerified for ring descriptors: similarity plus
/// Registration::inlier_ratio, which is 0 if the similarity is too low to register.
const Calibration& verified_calibration();

}  // namespace revisit
