#include "revisit/maps/map.h"

#include <algorithm>
#include <atomic>
#include <charconv>
#include <iostream>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "known_entries.h"
#include "map_file.h"
#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/base/text.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/optional_library.h"
#include "revisit/recognition/ring/descriptor.h"

namespace revisit {
namespace {

/// Must be raised with every change of the descriptor of a given scan.
constexpr int kRecognizerVersion = 1;

constexpr const char* kNoPoints = "the scan has no points";

/// Without the comparison.
Loop loop_to(const KnownEntries& entries, int64_t index) {
  const MapEntry& entry = entries.at(index);
  return {.index = index,
          .id = entry.id,
          .drive = entry.drive,
          .frame = entry.frame,
          .time = entry.time,
          .pose = entry.pose,
          .ambiguous = entries.is_ambiguous(index)};
}

/// Thread-safe. Keeps references to its arguments.
class ScanDescriber {
 public:
  /// Throws UsageError for a feature that is not computed from scans.
  ScanDescriber(const FeatureExtractor& extractor, const MapOptions& options)
      : extractor_(extractor), options_(options) {
    // Create one worker now: an unusable extractor throws here, not at the first scan.
    give_back(take());
  }
  Description describe(const PointsView& points) const {
    std::unique_ptr<Worker> worker = take();
    Description scan{.made_by = extractor_.key};
    copy_points(points, worker->cloud);
    transform(options_.mount, worker->cloud);
    scan.feature.resize(static_cast<size_t>(extractor_.dim));
    try {
      if (std::ranges::none_of(worker->cloud.points, is_return)) throw InputError(kNoPoints);
      if (const std::string defect = find_unit_defect(worker->cloud); !defect.empty())
        throw InputError(defect);
      worker->describe(worker->cloud, scan.feature);
      if (!is_usable(scan.feature)) throw InputError("its feature has ", kTooLarge);
    } catch (const InputError& error) {
      scan = {.error = error.what()};
    }
    give_back(std::move(worker));
    return scan;
  }

 private:
  struct Worker {
    FeatureFunction<PointCloud> describe;
    PointCloud cloud;
  };
  std::unique_ptr<Worker> take() const {
    const std::scoped_lock lock(mutex_);
    if (idle_.empty())
      return std::make_unique<Worker>(
          Worker{from_scan(extractor_, options_.align, options_.geometry), {}});
    std::unique_ptr<Worker> worker = std::move(idle_.back());
    idle_.pop_back();
    return worker;
  }
  void give_back(std::unique_ptr<Worker> worker) const {
    const std::scoped_lock lock(mutex_);
    idle_.push_back(std::move(worker));
  }

  const FeatureExtractor& extractor_;
  const MapOptions& options_;
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Worker>> idle_;
};

/// Throws UsageError.
void check(const MapOptions& options) {
  if (options.warmup < 2)
    throw UsageError(str("warm-up: expected at least 2 entries, found ", options.warmup));
  if (options.threads < 1)
    throw UsageError("threads: expected at least 1, found ", options.threads);
  if (options.k < 1) throw UsageError("k: expected at least 1, found ", options.k);
  if (options.hnsw_candidates < 0)
    throw UsageError(str("HNSW candidates: expected at least 0, found ", options.hnsw_candidates));
  if (options.local_map != 0 && !(options.local_map >= 1 && options.local_map <= 200))
    throw UsageError("local map: expected 1 to 200 m, found ", options.local_map);
  if (options.hnsw_candidates > 0 && !optional_library("FAISS").built_in)
    built_without("candidates of a large map", "FAISS");  // now, not when the warm-up ends
}

Score score_of(const FeatureExtractor& extractor, const MapOptions& options) {
  if (options.score) return *options.score;
  if (extractor.calibration) return extractor.calibration->score;
  return extractor.comparison.same_place ? Score::kDistinctMargin : Score::kMargin;
}

/// Sensor of the shipped model of an existing map; "" for a new one.
std::string sensor_of_map(const std::filesystem::path& file, MapAccess access) {
  const std::string key = feature_key_of(file);
  if (key.empty()) {
    namespace fs = std::filesystem;
    std::error_code none;  // a server's address is no file
    const bool is_new =
        !fs::exists(file, none) || (fs::is_regular_file(file, none) && fs::is_empty(file, none));
    if (!file.empty() && (access == MapAccess::kRead || !is_new))
      open_map(file, MapAccess::kRead);  // throws
    if (!file.empty() && !is_server_address(file.string())) check_target(file);
    return "";
  }
  const std::string sensor = shipped_ring_sensor(key);
  if (sensor.empty())
    throw InputError(display_name(file), ": its feature is not that of a shipped ring model but '",
                     key, "'; open the map with this feature");
  return sensor;
}

/// The map of one feature.
struct Described {
  const FeatureExtractor extractor;
  const bool is_temporary;
  const std::unique_ptr<MapStore> store;
  const ScanDescriber describer;
  KnownEntries entries;

  Described(FeatureExtractor feature, const MapOptions& options, std::unique_ptr<MapStore>&& map,
            const MapStore::Warn& warn)
      : extractor(std::move(feature)),
        is_temporary(map == nullptr),
        store(is_temporary ? temporary_map(fingerprint_of(extractor, options)) : std::move(map)),
        describer(extractor, options),
        entries(extractor, options, *store, is_temporary, warn) {}
};

}  // namespace

struct Map::Impl {
  const std::filesystem::path file;
  const MapStore::Warn warn;
  mutable std::shared_mutex mutex;  // guards the following members
  MapOptions options;
  std::unique_ptr<Described> described;  // null: the sensor is not known
  std::atomic<bool> checks_view = false;

  Impl(std::filesystem::path path, const MapOptions& chosen, const MapStore::Warn& say)
      : file(std::move(path)), warn(or_standard_error(say)), options(chosen) {
    check(options);
  }

  void open(FeatureExtractor extractor, std::unique_ptr<MapStore>&& map) {
    if (options.hnsw_candidates > 0 && extractor.comparison.similarity)
      throw UsageError("HNSW candidates: only for features compared by cosine, found '",
                       extractor.name, "'");
    if (map) must_match(map->name(), map->fingerprint(), fingerprint_of(extractor, options));
    options.score = score_of(extractor, options);
    described = std::make_unique<Described>(std::move(extractor), options, std::move(map), warn);
  }

  void open_rings(const std::string& sensor) {
    const RingModel model = shipped_ring_model(sensor);
    FeatureExtractor rings = ring_recognizer(
        model, ring_net(model), {.candidates = kRingCandidates}, {.threads = options.threads});
    const MapFingerprint fingerprint = fingerprint_of(rings, options);
    open(std::move(rings), file.empty() ? nullptr : open_map(file, options.access, &fingerprint));
    options.sensor = sensor;
  }

  /// Opens the map if the sensor was not known. Returns "", or why the scan does not show it.
  std::string find_sensor(const PointsView& points) {
    constexpr int64_t kMinReturns = 500;
    const std::unique_lock lock(mutex);
    if (described) return "";
    std::vector<PointCloud> scans(1);
    copy_points(points, scans.front());
    const auto returns = std::ranges::count_if(scans.front().points, is_return);
    if (returns == 0) return kNoPoints;
    if (std::string defect = find_unit_defect(scans.front()); !defect.empty()) return defect;
    transform(options.mount, scans.front());
    if (const std::string of_map = sensor_of_map(file, options.access); !of_map.empty()) {
      open_rings(of_map);  // another process has made it meanwhile
      return "";
    }
    if (options.local_map == 0 && returns < kMinReturns)
      return str("the scan has ", returns, " returns, too few to recognize the sensor (at least ",
                 kMinReturns, "); give the sensor");
    const auto [sensor, reason] =
        options.local_map == 0 ? choose_ring_model(scans)
                               : std::pair<std::string, std::string>("hdl64", "of local maps");
    open_rings(sensor);
    warn(str("sensor: ", sensor, " (", reason, ")"));
    return "";
  }

  /// Warns of the first scan.
  void check_view(const PointsView& points) {
    if (!checks_view.exchange(false)) return;
    std::vector<PointCloud> scans(1);
    copy_points(points, scans.front());
    transform(options.mount, scans.front());
    if (const std::string defect = find_view_defect(scans); !defect.empty()) warn(defect);
  }

  Described& known() const {
    if (described) return *described;
    throw UsageError("the map has no entries, and its sensor is not known; describe a scan first");
  }
};

Map::Map(const std::filesystem::path& file, const MapOptions& options, const MapStore::Warn& warn)
    : impl_(std::make_unique<Impl>(file, options, warn)) {
  const bool is_auto = options.sensor.empty() || options.sensor == "auto";
  const std::string sensor = is_auto ? sensor_of_map(file, options.access) : options.sensor;
  if (is_auto) impl_->options.sensor.clear();
  if (!sensor.empty()) impl_->open_rings(sensor);
  impl_->checks_view = true;
}

Map::Map(FeatureExtractor extractor, const MapOptions& options, std::unique_ptr<MapStore>&& map,
         const MapStore::Warn& warn)
    : impl_(std::make_unique<Impl>("", options, warn)) {
  impl_->open(std::move(extractor), std::move(map));
}

Map::~Map() = default;

MapStore::Warn or_standard_error(const MapStore::Warn& warn) {
  if (warn) return warn;
  return [](const std::string& what) { std::cerr << "revisit: " << what << "\n"; };
}

MapFingerprint fingerprint_of(const FeatureExtractor& extractor, const MapOptions& options) {
  check(options);
  const ImageGeometry& g = options.geometry;
  std::string key = extractor.key;
  std::ranges::replace(key, '\n', ' ');  // a line each in a map
  MapFingerprint fingerprint{
      {"recognizer version", str(kRecognizerVersion)},
      {"feature", extractor.name},
      {kFeatureKey, key},
      {kFeatureDimensions, str(extractor.dim)},
      {"alignment", name_of(options.align)},
      {"image", extractor.sees<RangeImage>()
                    ? str(g.width, " x ", g.height, ", ", g.elevation_bottom, " to ",
                          g.elevation_top, " deg, ", g.max_range, " m, closed ", g.closing_width,
                          " x ", g.closing_height, " deg")
                    : "none"}};
  if (options.local_map != 0) fingerprint[kLocalMap] = str(exact(options.local_map), " m");
  return fingerprint;
}

double local_map_of(const MapFingerprint& fingerprint) {
  double meters = 0;
  if (const auto entry = fingerprint.find(kLocalMap); entry != fingerprint.end())
    std::from_chars(entry->second.data(), entry->second.data() + entry->second.size(), meters);
  return meters;
}

Description Map::describe(const PointsView& points) const {
  if (extractor() == nullptr)
    if (std::string error = impl_->find_sensor(points); !error.empty())
      return {.error = std::move(error)};
  Description description = impl_->described->describer.describe(points);
  if (description.described()) impl_->check_view(points);
  return description;
}

std::vector<int64_t> Map::add(std::vector<MapEntry> entries, const std::string& made_by) {
  const std::unique_lock lock(impl_->mutex);
  KnownEntries& known = impl_->known().entries;
  for (const MapEntry& entry : entries) known.check_feature(entry.feature, made_by);
  std::vector<int64_t> indices;
  for (const int64_t id : known.add(std::move(entries))) {
    const auto index = known.find(id);
    if (!index) throw InputError("entry ", id, " was added to the map, but cannot be read from it");
    indices.push_back(*index);
  }
  return indices;
}

int64_t Map::remove(std::span<const int64_t> indices) {
  const std::unique_lock lock(impl_->mutex);
  return impl_->known().entries.remove(indices);
}

int64_t Map::refresh() {
  const std::unique_lock lock(impl_->mutex);
  if (!impl_->described) return 0;
  KnownEntries& entries = impl_->described->entries;
  if (entries.has_updates()) entries.load_updates();
  return entries.loadings();
}

std::optional<Loop> Map::query(const Description& scan, std::span<const int64_t> exclude) const {
  const std::shared_lock lock(impl_->mutex);
  if (!scan.described()) return std::nullopt;
  const KnownEntries& entries = impl_->known().entries;
  const Match match = entries.best(scan, exclude);
  if (match.ranks.empty()) return std::nullopt;
  Loop loop = loop_to(entries, match.ranks.front());
  loop.similarity = match.similarities.front();
  loop.kth_similarity = match.similarities.back();
  loop.score = match.score;
  loop.relative_yaw = match.relative_yaw;
  return loop;
}

Loop Map::compare(const Description& scan, int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  const KnownEntries& entries = impl_->known().entries;
  Loop loop = loop_to(entries, index);
  loop.similarity = loop.kth_similarity = loop.score = entries.similarity(scan, index);
  loop.relative_yaw = entries.relative_yaw(scan, index);
  return loop;
}

double Map::similarity(const Description& scan, int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->known().entries.similarity(scan, index);
}

int64_t Map::size() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described ? impl_->described->entries.size() : 0;
}

int64_t Map::distinct() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described ? impl_->described->entries.distinct() : 0;
}

bool Map::is_warmed_up() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described && impl_->described->entries.is_complete();
}

MapEntry Map::entry(int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->known().entries.at(index);
}

DriveEntries Map::entries_of(const std::string& drive) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described ? impl_->described->entries.entries_of(drive) : DriveEntries();
}

std::set<std::string> Map::drives() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described ? impl_->described->entries.drives() : std::set<std::string>();
}

std::vector<int64_t> Map::around(int64_t index, bool margin) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->known().entries.around(index, margin);
}

void Map::use_store(const std::function<void(MapStore&)>& work) const {
  const std::unique_lock lock(impl_->mutex);
  work(*impl_->known().store);
}

MapOptions Map::options() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->options;
}

const FeatureExtractor* Map::extractor() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->described ? &impl_->described->extractor : nullptr;
}

}  // namespace revisit
