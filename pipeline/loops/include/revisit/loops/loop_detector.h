#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "revisit/loops/keyframes.h"
#include "revisit/loops/local_map.h"
#include "revisit/loops/recent_places.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/registration/registration.h"

namespace revisit {

struct LoopDetectorOptions {
  std::string drive;  // recording in the map; drive_in_map() may add a number
  Exclusion exclusion;
  KeyframeRule keyframes;
  /// Registers the most similar entries and accepts loops by their fit as well (verified_score.h).
  /// Absent: enabled if the feature estimates the relative yaw and points are kept. If false,
  /// PlaceRecognizer decides.
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

enum class Rejection {
  kNone,
  kScore,       // below the threshold, or too few candidates; not registered
  kSimilarity,  // score above the threshold, but similarity too low to register
  kAmbiguous,
  kNoPoints,
  kRegistration,
};
/// Returns "", "score", "similarity", "ambiguous", "no points" or "registration".
const char* name_of(Rejection rejection);

struct Detection {
  std::string error;             // empty: the scan was described
  std::optional<int64_t> index;  // index of the entry; absent: no keyframe
  /// The most similar entry, or the better fitting one of two. If loops are registered, its score
  /// is Score::kVerified, with the probability for this score.
  std::optional<Loop> loop;
  /// Registration of `loop`, if it is similar enough; accepted if and only if the loop is.
  std::optional<Registration> registered;
  Rejection rejection = Rejection::kNone;
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
  /// Throws what PlaceRecognizer::add() throws, and UsageError if the exclusion needs a time or a
  /// pose that `scan` lacks. With local maps, a scan without a pose is not described.
  Detection take(const PointsView& points, const ScanStamp& scan);
  const std::string& drive() const { return options_.drive; }
  /// True if accepted loops have a pose (Detection::registered).
  bool verifies() const { return verifies_; }
  /// Score::kVerified, or PlaceRecognizer::score() if loops are not registered.
  Score score() const;
  /// Threshold and calibration for this score; absent if no calibration reaches the precision.
  std::optional<double> threshold() const;
  std::optional<Calibration> calibration() const;

 private:
  /// Index of a scan that the map had before. Identifies the recording at the first scan.
  std::optional<int64_t> stored(const Description& scan, const PointsView& points,
                                const ScanStamp& stamp);
  bool is_first_halt(const Description& scan) const;
  void verify(const Description& scan, const PointCloud& query, std::vector<int64_t> excluded,
              Detection& found) const;
  bool register_place(const PreparedScan& query, Loop& loop, Detection& found) const;

  PlaceRecognizer& recognizer_;
  LoopDetectorOptions options_;
  bool verifies_;
  std::string name_;                  // recording, as given
  std::vector<RecentPlaces> recent_;  // by the exclusion; for local maps also by overlap
  Keyframes keyframes_;
  std::optional<LocalMap> local_map_;
  std::optional<int64_t> last_;  // index of the entry of the preceding scan
  bool identified_ = false;
  // frame -> index of its scans that the map had before; `ahead_`: those not reached yet.
  std::map<int64_t, int64_t> stored_, ahead_;
};

}  // namespace revisit
