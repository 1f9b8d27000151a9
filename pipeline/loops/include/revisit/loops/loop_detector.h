#pragma once

#include <memory>
#include <optional>
#include <string>

#include "revisit/loops/recent_places.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/registration/registration.h"

namespace revisit::pipeline {

struct LoopDetectorOptions {
  std::string drive;    // name of this drive in the map
  Exclusion exclusion;  // of the drive's own scans
  bool verify = false;  // registers accepted loops; those that do not fit are not accepted
  RegistrationOptions registration;
};

/// The result for one scan.
struct Detection {
  std::optional<int64_t> position;  // of its place in the recogniser; absent: not described ...
  std::string why_not;              // ... for this reason
  std::optional<Loop> loop;         // the most similar place
  std::optional<Registration> registered;  // absent, too, when the place's points are not at hand
};

/// The front end of loop closure: takes the scans of one drive in order, and says where each was
/// before. Every scan is described, compared with the places that are not excluded, and added.
///
///   LoopDetector detector(recognizer, {.drive = "monday", .verify = true});
///   const Detection found = detector.take({points.data(), n, sizeof(MyPoint)}, {.frame = 17});
///   if (found.loop && found.loop->accepted)
///     add_edge(found.loop->position, *found.position, found.registered->T_place_query);
class LoopDetector {
 public:
  /// `recognizer` must outlive this object. Throws UsageError when `verify` is set and the feature
  /// gives no heading to start from.
  LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options);
  ~LoopDetector();
  /// Throws what PlaceRecognizer::add() does, and UsageError when the exclusion needs a time or a
  /// pose that `scan` lacks.
  Detection take(const PointsView& points, const ScanStamp& scan);

 private:
  class PlaceClouds;
  PlaceRecognizer& recognizer_;
  LoopDetectorOptions options_;
  RecentPlaces recent_;
  std::unique_ptr<PlaceClouds> clouds_;  // null without verification
};

}  // namespace revisit::pipeline
