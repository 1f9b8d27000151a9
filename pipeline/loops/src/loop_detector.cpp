#include "revisit/loops/loop_detector.h"

#include <cmath>
#include <utility>

#include "revisit/base/error.h"
#include "revisit/loops/drive_name.h"
#include "revisit/loops/verified_score.h"
#include "revisit/recognition/align.h"
#include "revisit/registration/registration.h"

namespace revisit {

namespace {

/// Transforms a registration of mounted points to the sensors' frames. `mount`: of the query.
void to_sensor_frames(const Eigen::Isometry3d& mount_of_place, const Eigen::Isometry3d& mount,
                      Registration& registered) {
  registered.T_place_query = mount_of_place.inverse() * registered.T_place_query * mount;
  // Motions of the query and of the mounted query are related by the adjoint Ad(mount).
  const Eigen::Matrix3d R = mount.rotation();
  Eigen::Matrix3d cross;
  const Eigen::Vector3d& t = mount.translation();
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Eigen::Matrix<double, 6, 6> adjoint = Eigen::Matrix<double, 6, 6>::Zero();
  adjoint.topLeftCorner<3, 3>() = adjoint.bottomRightCorner<3, 3>() = R;
  adjoint.topRightCorner<3, 3>() = cross * R;
  registered.information = adjoint.transpose() * registered.information * adjoint;
}

Rejection rejection_of(const Loop& loop, std::optional<double> threshold) {
  const bool by_score = threshold && loop.score >= *threshold;
  return loop.ambiguous && by_score ? Rejection::kAmbiguous : Rejection::kScore;
}

}  // namespace

const char* name_of(Rejection rejection) {
  switch (rejection) {
    case Rejection::kNone:
      break;
    case Rejection::kScore:
      return "score";
    case Rejection::kSimilarity:
      return "similarity";
    case Rejection::kAmbiguous:
      return "ambiguous";
    case Rejection::kNoPoints:
      return "no points";
    case Rejection::kRegistration:
      return "registration";
  }
  return "";
}

LoopDetector::LoopDetector(PlaceRecognizer& recognizer, const LoopDetectorOptions& options)
    : recognizer_(recognizer),
      options_(options),
      verifies_(options.verify.value_or(options.keep_clouds && recognizer.estimates_yaw())),
      name_(options.drive),
      recent_{RecentPlaces(options.exclusion)},
      keyframes_(options.keyframes) {
  if (recognizer.has_map() && options.local_map != recognizer.local_map())
    throw UsageError("local map: ", options.local_map,
                     " m, expected as for the map: ", recognizer.local_map(), " m");
  if (options.local_map != 0) {
    local_map_.emplace(options.local_map);
    recent_.emplace_back(Exclusion{Exclusion::Kind::kMeters, options.local_map});
  }
  if (options.threshold && !std::isfinite(*options.threshold))
    throw UsageError("the threshold: expected a number, found ", *options.threshold);
  if (!(options.target_precision > 0 && options.target_precision < 1))
    throw UsageError("precision: expected more than 0 and less than 1, found ",
                     options.target_precision);
  if (verifies_ && !recognizer.estimates_yaw())
    throw UsageError(
        "verification: this feature estimates no relative yaw to start from; use ring descriptors");
}

Detection LoopDetector::take(const PointsView& given, const ScanStamp& scan) {
  if (local_map_ && !scan.pose)
    return {.error = str("scan ", scan.frame, " has no pose; a local map needs one")};
  const PointsView points = local_map_ ? local_map_->add(given, *scan.pose) : given;
  Detection found;
  std::vector<int64_t>& excluded = found.excluded;
  for (RecentPlaces& recent : recent_) {
    const std::span<const int64_t> places = recent.at(scan);
    excluded.insert(excluded.end(), places.begin(), places.end());
  }
  const Description description = recognizer_.describe(points);
  if (!description.described()) {
    found.error = description.error;
    return found;
  }
  recognizer_.refresh_if_updated();
  found.index = stored(description, points, scan);
  for (const auto& [frame, position] : ahead_) excluded.push_back(position);
  if (last_ && options_.exclusion.kind != Exclusion::Kind::kNone)
    for (const int64_t position : recognizer_.around(*last_)) excluded.push_back(position);
  found.loop = recognizer_.query(description, excluded);
  while (!ahead_.empty() && ahead_.begin()->first <= scan.frame) {
    for (RecentPlaces& recent : recent_) recent.add(ahead_.begin()->second);
    ahead_.erase(ahead_.begin());
  }
  PointCloud cloud;
  const bool keep_cloud = options_.keep_clouds && (verifies_ || recognizer_.has_map());
  if (keep_cloud || verifies_) {
    copy_points(points, cloud);
    transform(recognizer_.mount(), cloud);
  }
  if (found.loop && verifies_)
    verify(description, cloud, excluded, found);
  else if (found.loop && !found.loop->accepted)
    found.rejection = rejection_of(*found.loop, recognizer_.threshold());
  if (!found.index && !is_first_halt(description) &&
      keyframes_.is_one(recognizer_, description, scan.pose)) {
    found.index = recognizer_.add(
        description, {.drive = options_.drive,
                      .frame = scan.frame,
                      .time = scan.time,
                      .pose = scan.pose,
                      .cloud = keep_cloud ? compact_cloud(cloud, recognizer_.mount()) : ""});
    for (RecentPlaces& recent : recent_) recent.add(*found.index);
  }
  if (found.index) {
    keyframes_.add(*found.index, scan.pose);
    last_ = found.index;
  }
  return found;
}

std::optional<int64_t> LoopDetector::stored(const Description& scan, const PointsView& points,
                                            const ScanStamp& stamp) {
  const int64_t frame = stamp.frame;
  const auto there = stored_.find(frame);
  const bool is_there = there != stored_.end();
  if (is_there && is_same_scan(recognizer_, scan, stamp.time, there->second)) return there->second;
  if (identified_ && !is_there) return std::nullopt;
  // The first scan, or the first that differs from the recording identified so far.
  options_.drive = drive_in_map(recognizer_, name_, points, [&](const DrivePlaces& places) {
    const auto same = places.find(frame);
    return same == places.end() ? may_belong_to(places, frame)
                                : is_same_scan(recognizer_, scan, stamp.time, same->second);
  });
  stored_ = ahead_ = recognizer_.places_of(options_.drive);
  identified_ = true;
  const auto found = stored_.find(frame);
  return found == stored_.end() ? std::nullopt : std::optional(found->second);
}

/// Warm-up entries keep their features, 100 kB each: a halt would fill the memory or end the
/// warm-up with few distinct entries.
bool LoopDetector::is_first_halt(const Description& scan) const {
  constexpr double kStanding = 0.98;  // scans of a halt have at least 0.99
  return last_ && !recognizer_.is_warmed_up() && recognizer_.similarity(scan, *last_) >= kStanding;
}

Score LoopDetector::score() const {
  return verifies_ ? Score::kVerified : recognizer_.score();
}

std::optional<Calibration> LoopDetector::calibration() const {
  if (!verifies_) return recognizer_.calibration();
  const std::optional<Calibration> of_map = recognizer_.verified_calibration();
  return of_map ? of_map : verified_calibration();
}

std::optional<double> LoopDetector::threshold() const {
  if (!verifies_) return recognizer_.threshold();
  if (options_.threshold) return options_.threshold;
  return calibration()->threshold_for(options_.target_precision);
}

/// Adds the inlier ratio to the score of `loop`, which replaces found.loop unless that fits better,
/// because many points along a wall fit anywhere. Returns false without points.
bool LoopDetector::register_place(const PreparedScan& query, Loop& loop, Detection& found) const {
  StoredCloud place;
  try {
    place = expand_cloud(recognizer_.cloud(loop.index));
  } catch (const InputError&) {  // none, or corrupt points, which check_map() reports
    return false;
  }
  Registration registered = register_scans(query, PreparedScan(place.cloud, options_.registration),
                                           *loop.relative_yaw, options_.registration);
  loop.score += registered.inlier_ratio;
  const bool fits = found.registered && found.registered->accepted;
  if (std::pair(fits, found.loop->score) > std::pair(registered.accepted, loop.score)) return true;
  to_sensor_frames(place.mount, recognizer_.mount(), registered);
  found.registered = registered;
  found.loop = loop;
  return true;
}

void LoopDetector::verify(const Description& scan, const PointCloud& query,
                          std::vector<int64_t> excluded, Detection& found) const {
  constexpr double kMinSimilarity = 0.3;  // reached by 43 % of the scans of NCLT
  constexpr double kClear = 1;            // a second place could not win
  std::optional<Loop> second;
  found.loop->score = found.loop->similarity;
  bool has_points = true;
  if (found.loop->similarity >= kMinSimilarity) {
    const PreparedScan prepared(query, options_.registration);
    Loop first = *found.loop;
    has_points = register_place(prepared, first, found);
    if (!found.registered || !found.registered->accepted || first.score < kClear) {
      const std::vector<int64_t> near = recognizer_.near(first.index);
      excluded.insert(excluded.end(), near.begin(), near.end());
      excluded.push_back(first.index);
      second = recognizer_.query(scan, excluded);
    }
    if (second && second->similarity >= kMinSimilarity) {
      second->score = second->similarity;
      register_place(prepared, *second, found);
    }
  }
  Loop& loop = *found.loop;
  loop.probability = calibration()->probability(loop.score);
  const std::optional<double> least = threshold();
  loop.accepted = !loop.ambiguous && found.registered && found.registered->accepted && least &&
                  loop.score >= *least;
  if (found.registered) found.registered->accepted = loop.accepted;
  if (loop.accepted) return;
  found.rejection = rejection_of(loop, least);
  if (!has_points && !found.registered)
    found.rejection = Rejection::kNoPoints;
  else if (found.registered && found.rejection == Rejection::kScore)
    found.rejection = Rejection::kRegistration;
  else if (found.rejection == Rejection::kScore && least && loop.score >= *least)
    found.rejection = Rejection::kSimilarity;
}

}  // namespace revisit
