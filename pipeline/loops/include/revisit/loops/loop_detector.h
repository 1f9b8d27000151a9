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

namespace revisit::pipeline {

struct LoopDetectorOptions {
  std::string drive;       // name of the recording in the map; drive_in_map() adds a number
  Exclusion exclusion;     // of the drive's own scans
  KeyframeRule keyframes;  // which scans are stored
  /// Registers the places that look most alike, and accepts by how they fit, too
  /// (verified_score.h). Absent: where the feature gives a heading to start from, as rings do, and
  /// points are kept. Without it the recogniser accepts.
  std::optional<bool> verify;
  /// Of Score::kVerified: at least so much is accepted. Absent: from where `precision` is promised.
  std::optional<double> threshold;
  double precision = 0.99;  // share of accepted registered loops that are to be right
  bool keep_clouds = true;  // of places, to register later scans; without a map if loops are
  /// Fewer inliers than by themselves are enough: the similarity speaks, too.
  RegistrationOptions registration{.least_inliers = 0.25};
  /// Describes and registers what was seen on the last metres of the drive, by the scans' poses,
  /// instead of a scan alone: for sensors with a gap, or few points [m]; 0: not. With a map, that
  /// of RecognizerOptions.
  double local_map = 0;
};

/// Why a loop is not accepted.
enum class Refusal {
  kNone,
  kScore,         // below the threshold, or among too few places; not registered
  kSimilarity,    // above the threshold, but not similar enough to be registered
  kAmbiguous,     // the place looks like others: Loop::ambiguous
  kNoPoints,      // the place was stored without points to register with
  kRegistration,  // the points do not fit well enough
};
/// "", "score", "similarity", "ambiguous", "no points" or "registration".
const char* name_of(Refusal refusal);

/// The result for one scan.
struct Detection {
  std::string why_not;              // it could not be described; "": it was
  std::optional<int64_t> position;  // of its place in the recogniser; absent: no keyframe
  /// The most similar place, or of two the one that fits. Where loops are registered its score is
  /// of Score::kVerified, and its probability that of this score.
  std::optional<Loop> loop;
  /// Of a loop that is similar enough to be registered; accepted when the loop is.
  std::optional<Registration> registered;
  Refusal refusal = Refusal::kNone;  // of `loop`
  std::vector<int64_t> excluded;     // positions of places of the scan's own moment
};

/// The front end of loop closure: takes the scans of one drive in order, and says where each was
/// before. Every scan is described, compared with the places that are not excluded, and added. With
/// any exclusion, a scan is not compared with the halt in which it was taken. Until the feature has
/// learnt from the map's first stretch, of a halt only one scan is added.
/// A recording of which the map has scans, by name and content, is resumed: these are compared, but
/// not added again, and none of its later scans is a match.
///
///   LoopDetector detector(recognizer, {.drive = "monday"});
///   const Detection found = detector.take({points.data(), n, sizeof(MyPoint)}, {.frame = 17});
///   if (found.loop && found.loop->accepted)
///     close_loop(found.loop->id, found.registered->T_place_query);
class LoopDetector {
 public:
  /// `recognizer` must outlive this object. Throws UsageError for invalid options, and when
  /// `verify` is set and the feature gives no heading to start from.
  LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options);
  /// Throws what PlaceRecognizer::add() does, and UsageError when the exclusion needs a time or a
  /// pose that `scan` lacks. A scan without a pose has no local map, and is not described.
  Detection take(const PointsView& points, const ScanStamp& scan);
  /// The name of the recording in the map.
  const std::string& drive() const { return options_.drive; }
  /// Whether accepted loops have a pose (Detection::registered).
  bool verifies() const { return verifies_; }
  /// How sure loops are: Score::kVerified, or the recogniser's where they are not registered.
  Score score() const;
  /// Of this score; absent when no calibration promises the precision.
  std::optional<double> threshold() const;
  std::optional<Calibration> calibration() const;

 private:
  /// The position of a scan that the map had before this object. Names the recording.
  std::optional<int64_t> stored(const Description& scan, const PointsView& points,
                                const ScanStamp& stamp);
  bool is_first_halt(const Description& scan) const;
  void verify(const Description& scan, const PointCloud& query, std::vector<int64_t> excluded,
              Detection& found) const;
  bool register_place(const PreparedScan& query, Loop& loop, Detection& found) const;

  PlaceRecognizer& recognizer_;
  LoopDetectorOptions options_;
  bool verifies_;
  std::string name_;                  // of the recording, as given
  std::vector<RecentPlaces> recent_;  // by the exclusion; of local maps those that overlap, too
  Keyframes keyframes_;
  std::optional<LocalMap> local_map_;
  std::optional<int64_t> last_;  // position of the scan before that is a place
  bool identified_ = false;      // the recording
  // frame -> position of its scans that the map had before; those not reached yet.
  std::map<int64_t, int64_t> stored_, ahead_;
};

}  // namespace revisit::pipeline
