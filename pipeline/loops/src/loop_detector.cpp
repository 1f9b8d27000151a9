#include "revisit/loops/loop_detector.h"

#include <algorithm>
#include <utility>

#include "acceptance.h"
#include "local_map.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/align.h"
#include "verification.h"

namespace revisit {
namespace {

class Keyframes {
 public:
  /// "all", "meters=L" or "similarity=S"; throws UsageError for anything else.
  explicit Keyframes(const std::string& text) {
    if (text == "all") return;
    const size_t equals = std::min(text.find('='), text.size());
    kind_ = text.substr(0, equals);
    const bool is_similarity = kind_ == "similarity";
    amount_ =
        finite_number(std::string_view(text).substr(std::min(equals + 1, text.size()))).value_or(0);
    if ((!is_similarity && kind_ != "meters") || amount_ <= 0 || (is_similarity && amount_ > 1))
      throw UsageError("keyframes: expected all, meters=L or similarity=S (above 0, at most 1), ",
                       "found '", text, "'");
  }
  /// Throws UsageError if the rule needs a pose and there is none.
  bool is_one(const Map& map, const Description& scan,
              const std::optional<Eigen::Isometry3d>& pose) const {
    if (kind_ == "all") return true;
    if (kind_ == "meters" && !pose)
      throw UsageError("keyframes: meters=L needs poses, which the scans lack; use similarity=S");
    if (!last_) return true;
    if (kind_ == "similarity") return map.similarity(scan, *last_) < amount_;
    return !pose_ || (pose->translation() - pose_->translation()).norm() >= amount_;
  }
  void add(int64_t index, const std::optional<Eigen::Isometry3d>& pose) {
    last_ = index;
    pose_ = pose;
  }

 private:
  std::string kind_ = "all";
  double amount_ = 0;
  std::optional<int64_t> last_;
  std::optional<Eigen::Isometry3d> pose_;
};

}  // namespace

void check_keyframes(const std::string& text) {
  Keyframes{text};
}

std::span<const int64_t> RecentEntries::at(const ScanStamp& scan,
                                           const std::optional<double>& registered) {
  std::optional<Eigen::Vector3d> position;
  if (scan.pose) position = scan.pose->translation();
  along_ = driven_.at(scan.frame, scan.time, position, registered);
  if (exclusion_.kind == Exclusion::Kind::kNone) entries_.clear();
  while (!entries_.empty() && along_ - entries_.front().second > exclusion_.amount)
    entries_.pop_front();
  indices_.clear();
  for (const auto& [entry, along] : entries_) indices_.push_back(entry);
  return indices_;
}

void RecentEntries::add(int64_t index) {
  entries_.emplace_back(index, along_);
}

struct LoopDetector::Impl {
  const std::unique_ptr<Map> own_map;  // null: the caller's
  Map& map;
  LoopDetectorOptions options;
  const bool verifies;
  const Eigen::Isometry3d mount;
  Acceptance acceptance;
  const std::string name;             // recording, as given
  std::vector<RecentEntries> recent;  // by the exclusion; for local maps also by overlap
  Keyframes keyframes;
  std::optional<LocalMap> local_map;
  Odometry odometry;  // of single scans without poses, for local maps
  bool was_posed = false;
  Verification verification;
  std::optional<int64_t> last;  // index of the entry of the preceding scan
  std::optional<int64_t> last_frame;
  std::vector<int64_t> questioned;  // frames, since the last entry
  bool identified = false;
  int64_t loadings = 0;  // Map::refresh() at the latest scan
  // frame -> index of its scans that the map had before; `ahead`: those not reached yet.
  DriveEntries stored, ahead;

  Impl(std::unique_ptr<Map> own, Map& used, const LoopDetectorOptions& chosen);

  Detection take(const PointsView& points, const ScanStamp& stamp);
  std::vector<Detection> locate(const PointsView& points);
  Description describe(const PointsView& points);
  PointCloud mounted(const PointsView& points) const;
  PointsView accumulated(const PointsView& scan, const ScanStamp& stamp);
  std::vector<int64_t> temporal_neighbors(const ScanStamp& stamp);
  std::optional<int64_t> resume(const Description& scan, const PointsView& points,
                                const ScanStamp& stamp);
  void exclude_drive(const ScanStamp& stamp, std::vector<int64_t>& excluded);
  void match(const Description& scan, const SeenScan& seen, Detection& found);
  void store(const Description& scan, const SeenScan& seen, const ScanStamp& stamp,
             Detection& found);

  bool is_first_halt(const Description& scan) const;
};

namespace {

LoopDetectorOptions with_warn(LoopDetectorOptions options) {
  options.warn = or_standard_error(options.warn);
  return options;
}

bool estimates_yaw(const Map& map) {
  const FeatureExtractor* extractor = map.extractor();
  return extractor == nullptr || extractor->comparison.relative_yaw;  // null: rings
}

}  // namespace

LoopDetector::Impl::Impl(std::unique_ptr<Map> own, Map& used, const LoopDetectorOptions& chosen)
    : own_map(std::move(own)),
      map(used),
      options(with_warn(chosen)),
      verifies(options.verify.value_or(options.keep_clouds && estimates_yaw(map))),
      mount(map.options().mount),
      acceptance(map, options, verifies),
      name(options.drive),
      recent{RecentEntries(options.exclusion)},
      keyframes(options.keyframes),
      odometry(options.registration),
      verification(map, options, acceptance) {
  if (const double meters = map.options().local_map; meters != 0) {
    local_map.emplace(meters);
    recent.emplace_back(Exclusion{Exclusion::Kind::kMeters, meters});
  }
  if (verifies && !estimates_yaw(map))
    throw UsageError(
        "verification: this feature estimates no relative yaw to start from; use ring descriptors");
}

Detection LoopDetector::Impl::take(const PointsView& given, const ScanStamp& stamp) {
  if (last_frame && stamp.frame <= *last_frame)
    throw UsageError("frame ", stamp.frame, ": expected frames that ascend, found it after ",
                     *last_frame, "; give each scan of a drive the next number");
  last_frame = stamp.frame;
  const PointsView points = local_map ? accumulated(given, stamp) : given;
  Detection found;
  const Description description = describe(points);
  if (!description.described()) {
    found.error = description.error;
    return found;
  }
  const bool needs_cloud = options.keep_clouds || verifies;
  const SeenScan seen(needs_cloud ? mounted(points) : PointCloud(), options.registration);
  if (verifies)
    verification.arrive(description, seen, stamp,
                        local_map && !stamp.pose ? odometry.step() : std::nullopt);
  found.excluded = temporal_neighbors(stamp);
  found.index = resume(description, points, stamp);
  exclude_drive(stamp, found.excluded);
  match(description, seen, found);
  store(description, seen, stamp, found);
  return found;
}

std::vector<Detection> LoopDetector::Impl::locate(const PointsView& points) {
  const Description description = describe(points);
  if (!description.described()) return {{.error = description.error}};
  const std::optional<Loop> first = map.query(description);
  if (!first) return {Detection()};
  if (verifies)
    return verification.locate(description, {mounted(points), options.registration}, *first);
  Detection found{.loop = first};
  found.rejection = acceptance.decide(*found.loop);
  found.accepted = found.rejection.empty();
  return {found};
}

/// The first scan may tell the sensor; the map may get another calibration.
Description LoopDetector::Impl::describe(const PointsView& points) {
  Description description = map.describe(points);
  if (const int64_t now = map.refresh(); now != loadings) {
    acceptance.refresh();
    loadings = now;
  }
  return description;
}

PointCloud LoopDetector::Impl::mounted(const PointsView& points) const {
  PointCloud cloud;
  copy_points(points, cloud);
  transform(mount, cloud);
  return cloud;
}

/// The local map, by the poses of scans or else by registration of consecutive ones.
PointsView LoopDetector::Impl::accumulated(const PointsView& scan, const ScanStamp& stamp) {
  const bool is_posed = stamp.pose.has_value();
  if (std::exchange(was_posed, is_posed) != is_posed) local_map->clear();
  if (is_posed) return local_map->add(scan, *stamp.pose);
  const SeenScan seen(mounted(scan), options.registration);
  odometry.arrive(seen, stamp.frame, std::nullopt, std::nullopt);
  odometry.refer(stamp.frame, seen);
  if (odometry.is_lost()) local_map->clear();
  return local_map->add(scan, odometry.pose() * mount);
}

std::vector<int64_t> LoopDetector::Impl::temporal_neighbors(const ScanStamp& stamp) {
  const auto motion = local_map  ? odometry.motion()
                      : verifies ? verification.odometry().motion()
                                 : std::nullopt;
  std::vector<int64_t> neighbors;
  for (RecentEntries& one : recent) {
    const std::span<const int64_t> entries = one.at(stamp, motion);
    neighbors.insert(neighbors.end(), entries.begin(), entries.end());
  }
  return neighbors;
}

/// Index of a scan that the map had before. Identifies the recording at the first scan.
std::optional<int64_t> LoopDetector::Impl::resume(const Description& scan, const PointsView& points,
                                                  const ScanStamp& stamp) {
  const auto is_entry = [&](const DriveEntries::const_iterator& entry) {
    return is_same_scan(map, scan, stamp.time, entry->second);
  };
  const auto known = stored.find(stamp.frame);
  if (known != stored.end() && is_entry(known)) return known->second;
  if (identified && known == stored.end()) return std::nullopt;
  // The first scan, or the first that differs from the recording identified so far.
  options.drive = drive_in_map(map, name, points, [&](const DriveEntries& entries) {
    const auto same = entries.find(stamp.frame);
    return same == entries.end() ? may_belong_to(entries, stamp.frame) : is_entry(same);
  });
  stored = ahead = map.entries_of(options.drive);
  identified = true;
  const auto found = stored.find(stamp.frame);
  return found == stored.end() ? std::nullopt : std::optional(found->second);
}

/// Excludes entries of later scans, and of the halt in which the scan was taken.
void LoopDetector::Impl::exclude_drive(const ScanStamp& stamp, std::vector<int64_t>& excluded) {
  for (const auto& [frame, index] : ahead) excluded.push_back(index);
  if (last && options.exclusion.kind != Exclusion::Kind::kNone)
    for (const int64_t index : map.around(*last)) excluded.push_back(index);
  while (!ahead.empty() && ahead.begin()->first <= stamp.frame) {
    for (RecentEntries& one : recent) one.add(ahead.begin()->second);
    ahead.erase(ahead.begin());
  }
}

void LoopDetector::Impl::match(const Description& scan, const SeenScan& seen, Detection& found) {
  found.loop = map.query(scan, found.excluded);
  if (!found.loop) return;
  if (verifies)
    verification.verify(scan, seen, found);
  else
    found.rejection = acceptance.decide(*found.loop);
  found.accepted = found.rejection.empty();
}

void LoopDetector::Impl::store(const Description& scan, const SeenScan& seen,
                               const ScanStamp& stamp, Detection& found) {
  const auto scale = verifies ? std::optional(verification.scale()) : std::nullopt;
  std::ranges::copy(found.questioned, std::back_inserter(questioned));
  if (!found.index && !is_first_halt(scan) && keyframes.is_one(map, scan, stamp.pose)) {
    MapEntry entry{.drive = options.drive,
                   .frame = stamp.frame,
                   .time = stamp.time,
                   .pose = stamp.pose,
                   .feature = scan.feature,
                   .cloud = options.keep_clouds ? compact_cloud(seen.cloud(), mount, scale) : ""};
    if (found.accepted && found.registered)
      entry.loops = {{.place = found.loop->id,
                      .T_place_query = found.registered->T_place_query,
                      .information = found.registered->information}};
    if (!questioned.empty())
      for (const auto& [frame, index] : map.entries_of(options.drive))
        if (std::ranges::find(questioned, frame) != questioned.end())
          entry.questioned.push_back(map.entry(index).id);
    questioned.clear();
    found.index = map.add({std::move(entry)}, scan.made_by).front();
    for (RecentEntries& one : recent) one.add(*found.index);
  }
  if (!found.index) return;
  keyframes.add(*found.index, stamp.pose);
  if (verifies) verification.add(*found.index, seen);
  last = found.index;
}

/// Warm-up entries keep their features, 100 kB each: a halt would fill the memory or end the
/// warm-up with few distinct entries.
bool LoopDetector::Impl::is_first_halt(const Description& scan) const {
  constexpr double kStanding = 0.98;  // scans of a halt have at least 0.99
  return last && !map.is_warmed_up() && map.similarity(scan, *last) >= kStanding;
}

LoopDetector::LoopDetector(const LoopDetectorOptions& options) {
  auto map = std::make_unique<Map>(options.map, MapOptions{}, options.warn);
  Map& used = *map;
  impl_ = std::make_unique<Impl>(std::move(map), used, options);
}

LoopDetector::LoopDetector(Map& map, const LoopDetectorOptions& options) {
  if (!options.map.empty())
    throw UsageError("LoopDetectorOptions::map: ", options.map.string(),
                     ", but a Map is given, too; give one of the two");
  impl_ = std::make_unique<Impl>(nullptr, map, options);
}

LoopDetector::~LoopDetector() = default;

Detection LoopDetector::take(const PointsView& points, const ScanStamp& scan) {
  return impl_->take(points, scan);
}

std::vector<Detection> LoopDetector::locate(const PointsView& points) {
  return impl_->locate(points);
}

Map& LoopDetector::map() const {
  return impl_->map;
}

const std::string& LoopDetector::drive() const {
  return impl_->options.drive;
}

bool LoopDetector::verifies() const {
  return impl_->verifies;
}

Score LoopDetector::score() const {
  return impl_->acceptance.score();
}

std::optional<double> LoopDetector::threshold() const {
  return impl_->acceptance.threshold();
}

std::optional<Calibration> LoopDetector::calibration() const {
  return impl_->acceptance.calibration();
}

void LoopDetector::calibrate(const Calibration& calibration) {
  impl_->acceptance.calibrate(calibration);
}

const Calibration& verified_calibration() {
  // Computed by bench/verified_calibration.py.
  static const Calibration calibration = {
      .score = Score::kVerified,
      .trained_on =
          "20 drives: streets, offices, a car park, a mine, greenhouses, a forest, a yard, "
          "NCLT, MulRan Riverside, a walk",
      .blocks = {{-0.94, 6044.0089, 0.7546},
                 {-0.36, 178.3877, 7.4648},
                 {-0.06, 18.6990, 1.5435},
                 {-0.04, 7.2852, 2.7535},
                 {0, 164.6049, 163.4693},
                 {0.02, 517.0143, 517.0143}}};
  return calibration;
}

}  // namespace revisit
