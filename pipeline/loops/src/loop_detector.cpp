#include "revisit/loops/loop_detector.h"

#include <set>
#include <utility>

#include "acceptance.h"
#include "local_map.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/align.h"

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

std::span<const int64_t> RecentEntries::at(const ScanStamp& scan) {
  std::optional<Eigen::Vector3d> index;
  if (scan.pose) index = scan.pose->translation();
  along_ = driven_.at(scan.frame, scan.time, index);
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
  std::optional<int64_t> last;  // index of the entry of the preceding scan
  bool identified = false;
  int64_t loadings = 0;               // Map::refresh() at the latest scan
  mutable std::set<int64_t> corrupt;  // ids of entries whose points were reported
  // frame -> index of its scans that the map had before; `ahead`: those not reached yet.
  DriveEntries stored, ahead;

  Impl(std::unique_ptr<Map> own, Map& used, const LoopDetectorOptions& chosen);

  Detection take(const PointsView& points, const ScanStamp& stamp);
  Detection query(const PointsView& points);
  Description describe(const PointsView& points);
  PointCloud mounted(const PointsView& points) const;
  std::vector<int64_t> temporal_neighbors(const ScanStamp& stamp);
  std::optional<int64_t> resume(const Description& scan, const PointsView& points,
                                const ScanStamp& stamp);
  void exclude_drive(const ScanStamp& stamp, std::vector<int64_t>& excluded);
  void match(const Description& scan, const PointCloud& cloud, Detection& found) const;
  void store(const Description& scan, const PointCloud& cloud, const ScanStamp& stamp,
             Detection& found);

  bool is_first_halt(const Description& scan) const;
  void verify(const Description& scan, const PointCloud& query, Detection& found) const;
  bool register_entry(const PreparedScan& query, Loop& loop, Detection& found) const;
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
      keyframes(options.keyframes) {
  if (const double meters = map.options().local_map; meters != 0) {
    local_map.emplace(meters);
    recent.emplace_back(Exclusion{Exclusion::Kind::kMeters, meters});
  }
  if (verifies && !estimates_yaw(map))
    throw UsageError(
        "verification: this feature estimates no relative yaw to start from; use ring descriptors");
}

Detection LoopDetector::Impl::take(const PointsView& given, const ScanStamp& stamp) {
  if (local_map && !stamp.pose)
    return {.error = str("scan ", stamp.frame, " has no pose; a local map needs one")};
  const PointsView points = local_map ? local_map->add(given, *stamp.pose) : given;
  Detection found;
  found.excluded = temporal_neighbors(stamp);
  const Description description = describe(points);
  if (!description.described()) {
    found.error = description.error;
    return found;
  }
  const PointCloud cloud = options.keep_clouds || verifies ? mounted(points) : PointCloud();
  found.index = resume(description, points, stamp);
  exclude_drive(stamp, found.excluded);
  match(description, cloud, found);
  store(description, cloud, stamp, found);
  return found;
}

Detection LoopDetector::Impl::query(const PointsView& points) {
  Detection found;
  const Description description = describe(points);
  found.error = description.error;
  if (description.described()) match(description, verifies ? mounted(points) : PointCloud(), found);
  return found;
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

std::vector<int64_t> LoopDetector::Impl::temporal_neighbors(const ScanStamp& stamp) {
  std::vector<int64_t> neighbors;
  for (RecentEntries& one : recent) {
    const std::span<const int64_t> entries = one.at(stamp);
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

void LoopDetector::Impl::match(const Description& scan, const PointCloud& cloud,
                               Detection& found) const {
  found.loop = map.query(scan, found.excluded);
  if (!found.loop) return;
  if (verifies)
    verify(scan, cloud, found);
  else
    found.rejection = acceptance.decide(*found.loop);
  found.accepted = found.rejection.empty();
}

void LoopDetector::Impl::store(const Description& scan, const PointCloud& cloud,
                               const ScanStamp& stamp, Detection& found) {
  if (!found.index && !is_first_halt(scan) && keyframes.is_one(map, scan, stamp.pose)) {
    MapEntry entry{.drive = options.drive,
                   .frame = stamp.frame,
                   .time = stamp.time,
                   .pose = stamp.pose,
                   .feature = scan.feature,
                   .cloud = options.keep_clouds ? compact_cloud(cloud, mount) : ""};
    found.index = map.add({std::move(entry)}, scan.made_by).front();
    for (RecentEntries& one : recent) one.add(*found.index);
  }
  if (!found.index) return;
  keyframes.add(*found.index, stamp.pose);
  last = found.index;
}

/// Warm-up entries keep their features, 100 kB each: a halt would fill the memory or end the
/// warm-up with few distinct entries.
bool LoopDetector::Impl::is_first_halt(const Description& scan) const {
  constexpr double kStanding = 0.98;  // scans of a halt have at least 0.99
  return last && !map.is_warmed_up() && map.similarity(scan, *last) >= kStanding;
}

/// Adds the inlier ratio to the score of `loop`, which replaces found.loop unless that fits better,
/// because many points along a wall fit anywhere. Returns false without points.
bool LoopDetector::Impl::register_entry(const PreparedScan& query, Loop& loop,
                                        Detection& found) const {
  std::string bytes;
  std::pair<PointCloud, Eigen::Isometry3d> entry;  // with its mount
  try {
    map.use_store([&](MapStore& store) { bytes = store.cloud(loop.id); });
    if (bytes.empty()) return false;
    entry = expand_cloud(bytes);
  } catch (const InputError& error) {
    if (corrupt.insert(loop.id).second) options.warn(str("entry ", loop.id, ": ", error.what()));
    return false;
  }
  Registration registered = register_scans(query, PreparedScan(entry.first, options.registration),
                                           *loop.relative_yaw, options.registration);
  loop.score += registered.inlier_ratio;
  const bool fits = found.registered && found.registered->fits;
  if (std::pair(fits, found.loop->score) > std::pair(registered.fits, loop.score)) return true;
  to_sensor_frames(entry.second, mount, registered);
  found.registered = registered;
  found.loop = loop;
  return true;
}

void LoopDetector::Impl::verify(const Description& scan, const PointCloud& query,
                                Detection& found) const {
  constexpr double kMinSimilarity = 0.3;  // reached by 43 % of the scans of NCLT
  constexpr double kClear = 1;            // a second entry could not win
  std::optional<Loop> second;
  found.loop->score = found.loop->similarity;
  bool has_points = true;
  if (found.loop->similarity >= kMinSimilarity) {
    const PreparedScan prepared(query, options.registration);
    Loop first = *found.loop;
    has_points = register_entry(prepared, first, found);
    if (!found.registered || !found.registered->fits || first.score < kClear) {
      std::vector<int64_t> excluded = found.excluded;
      const std::vector<int64_t> near = map.around(first.index, true);
      excluded.insert(excluded.end(), near.begin(), near.end());
      excluded.push_back(first.index);
      second = map.query(scan, excluded);
    }
    if (second && second->similarity >= kMinSimilarity) {
      second->score = second->similarity;
      register_entry(prepared, *second, found);
    }
  }
  found.rejection = acceptance.decide(*found.loop);
  if (!has_points && !found.registered)
    found.rejection = "no points";
  else if (found.registered && (found.rejection == "score" || !found.registered->fits))
    found.rejection = found.rejection == "ambiguous" ? "ambiguous" : "registration";
  else if (!found.registered && found.rejection.empty())
    found.rejection = "similarity";
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

Detection LoopDetector::query(const PointsView& points) {
  return impl_->query(points);
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
      .trained_on = "NCLT, MulRan Riverside and 16 simulated drives",
      .blocks = {{-0.0093, 8066.9809, 0.1000},
                 {0.6160, 41.4551, 0.2000},
                 {0.6650, 5.5937, 0.1667},
                 {0.6766, 6.2692, 0.1909},
                 {0.7010, 31.1412, 1.6333},
                 {0.7571, 5.0667, 0.2909},
                 {0.7660, 14.9141, 1.9000},
                 {0.8116, 8.7723, 1.9497},
                 {0.8454, 2.6398, 0.9000},
                 {0.8683, 9.8858, 5.8202},
                 {0.9292, 395.3469, 393.9141},
                 {1.5967, 501.9342, 501.9342}}};
  return calibration;
}

}  // namespace revisit
