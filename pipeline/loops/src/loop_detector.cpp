#include "revisit/loops/loop_detector.h"

#include <string>
#include <unordered_map>

#include "revisit/base/error.h"
#include "revisit/registration/compact_cloud.h"

namespace revisit::pipeline {

/// The points of this drive's places.
class LoopDetector::PlaceClouds {
 public:
  void keep(int64_t position, const PointCloud& cloud) { clouds_[position] = compact_cloud(cloud); }
  /// Nothing for a place of another drive.
  std::optional<PointCloud> at(int64_t position) const {
    const auto found = clouds_.find(position);
    if (found == clouds_.end()) return std::nullopt;
    return expand_cloud(found->second);
  }

 private:
  std::unordered_map<int64_t, std::string> clouds_;
};

LoopDetector::LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options)
    : recognizer_(recognizer), options_(options), recent_(options.exclusion) {
  if (!options.verify) return;
  if (!recognizer.finds_heading())
    throw UsageError(CppName{"LoopDetectorOptions::verify"},
                     ": this feature gives no heading to start from; use rings");
  clouds_ = std::make_unique<PlaceClouds>();
}

LoopDetector::~LoopDetector() = default;

Detection LoopDetector::take(const PointsView& points, const ScanStamp& scan) {
  const std::span<const int64_t> excluded = recent_.at(scan);
  Detection found;
  const Description description = recognizer_.describe(points);
  if (!description.described()) {
    found.why_not = description.why_not;
    return found;
  }
  recognizer_.refresh_on_news();
  found.loop = recognizer_.query(description, excluded);
  found.position = recognizer_.add(
      description,
      {.drive = options_.drive, .frame = scan.frame, .time = scan.time, .pose = scan.pose});
  recent_.add(*found.position);
  if (!clouds_) return found;
  PointCloud cloud;
  copy_points(points, cloud);
  clouds_->keep(*found.position, cloud);
  if (!found.loop || !found.loop->accepted) return found;
  if (const auto place = clouds_->at(found.loop->position)) {
    const RegistrationOptions& options = options_.registration;
    found.registered = register_scans(PreparedScan(cloud, options), PreparedScan(*place, options),
                                      *found.loop->turn, options);
    found.loop->accepted = found.registered->accepted;
  }
  return found;
}

}  // namespace revisit::pipeline
