#include "revisit/loops/loop_detector.h"

#include <cmath>
#include <unordered_map>
#include <utility>

#include "revisit/base/error.h"
#include "revisit/loops/drive_name.h"

namespace revisit::pipeline {

/// The thinned points of this drive's places.
class LoopDetector::PlaceClouds {
 public:
  explicit PlaceClouds(const RegistrationOptions& options) : options_(options) {}

  void keep(int64_t position, const PreparedScan& scan) {
    std::vector<Eigen::Matrix<int16_t, 3, 1>>& kept = clouds_[position];
    kept.reserve(scan.points().size());
    for (const Eigen::Vector3f& point : scan.points())
      kept.emplace_back((point * kStepsPerMetre).array().round().matrix().cast<int16_t>());
  }
  /// Nothing for a place of another drive.
  std::optional<PreparedScan> at(int64_t position) const {
    const auto found = clouds_.find(position);
    if (found == clouds_.end()) return std::nullopt;
    PointCloud cloud;
    for (const Eigen::Matrix<int16_t, 3, 1>& steps : found->second) {
      const Eigen::Vector3f point = steps.cast<float>() / kStepsPerMetre;
      cloud.points.push_back({point.x(), point.y(), point.z()});
    }
    return PreparedScan(cloud, options_);
  }

 private:
  static constexpr float kStepsPerMetre = 128;  // 16 bits reach 256 m, scans 200 m
  RegistrationOptions options_;
  std::unordered_map<int64_t, std::vector<Eigen::Matrix<int16_t, 3, 1>>> clouds_;
};

LoopDetector::LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options)
    : recognizer_(recognizer), options_(options), recent_(options.exclusion) {
  if (!options.verify) return;
  if (!recognizer.finds_heading())
    throw UsageError(CppName{"LoopDetectorOptions::verify"},
                     ": this feature gives no heading to start from; use rings");
  clouds_ = std::make_unique<PlaceClouds>(options.registration);
}

LoopDetector::~LoopDetector() = default;

Detection LoopDetector::take(const PointsView& points, const ScanStamp& scan) {
  const std::span<const int64_t> recent = recent_.at(scan);
  Detection found;
  const Description description = recognizer_.describe(points);
  if (!description.described()) {
    found.why_not = description.why_not;
    return found;
  }
  recognizer_.refresh_on_news();
  if (!std::exchange(identified_, true)) {
    options_.drive = drive_in_map(recognizer_, options_.drive, description, scan.frame);
    ahead_ = recognizer_.places_of(options_.drive);
  }
  std::vector<int64_t> excluded(recent.begin(), recent.end());
  for (const auto& [frame, position] : ahead_) excluded.push_back(position);
  found.loop = recognizer_.query(description, excluded);
  while (!ahead_.empty() && ahead_.begin()->first <= scan.frame) {
    const auto [frame, position] = *ahead_.begin();
    recent_.add(position);
    if (frame == scan.frame) found.position = position;
    ahead_.erase(ahead_.begin());
  }
  if (!found.position) {
    found.position = recognizer_.add(
        description,
        {.drive = options_.drive, .frame = scan.frame, .time = scan.time, .pose = scan.pose});
    recent_.add(*found.position);
  }
  if (!clouds_) return found;
  PointCloud cloud;
  copy_points(points, cloud);
  const PreparedScan prepared(cloud, options_.registration);
  clouds_->keep(*found.position, prepared);
  if (!found.loop || !found.loop->accepted) return found;
  if (const auto place = clouds_->at(found.loop->position)) {
    found.registered = register_scans(prepared, *place, *found.loop->turn, options_.registration);
    found.loop->accepted = found.registered->accepted;
  }
  return found;
}

}  // namespace revisit::pipeline
