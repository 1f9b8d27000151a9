#include "revisit/maps/place_recognizer.h"

#include <algorithm>
#include <charconv>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "acceptance.h"
#include "known_entries.h"
#include "map_file.h"
#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/align.h"
#include "revisit/recognition/optional_library.h"

namespace revisit {
namespace {

/// Must be raised with every change of the descriptor of a given scan.
constexpr int kRecognizerVersion = 1;

/// Thread-safe. Keeps references to its arguments.
class ScanDescriber {
 public:
  /// Throws UsageError for a feature that is not computed from scans.
  ScanDescriber(const FeatureExtractor& extractor, const RecognizerOptions& options)
      : extractor_(extractor), options_(options) {
    // Create one worker now: an unusable extractor throws here, not at the first scan.
    give_back(take());
  }
  Description describe(const PointsView& points) const {
    std::unique_ptr<Worker> worker = take();
    Description scan;
    copy_points(points, worker->cloud);
    transform(options_.mount, worker->cloud);
    scan.feature.resize(static_cast<size_t>(extractor_.dim));
    try {
      if (std::ranges::none_of(worker->cloud.points, is_return))
        throw InputError("the scan has no points");
      worker->describe(worker->cloud, scan.feature);
      if (!is_usable(scan.feature)) throw InputError("its feature has ", kTooLarge);
    } catch (const InputError& error) {
      scan = {{}, error.what()};
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
  const RecognizerOptions& options_;
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Worker>> idle_;
};

}  // namespace

struct PlaceRecognizer::Impl {
  const FeatureExtractor extractor;
  const RecognizerOptions options;
  const MapStore::Warn warn;
  const ScanDescriber describer;
  const bool has_map;
  const std::unique_ptr<MapStore> map;

  mutable std::shared_mutex mutex;  // guards the following members and the map
  Acceptance acceptance;
  KnownEntries entries;

  Impl(FeatureExtractor feature, const RecognizerOptions& chosen, std::unique_ptr<MapStore>&& store,
       MapStore::Warn say)
      : extractor(std::move(feature)),
        options(chosen),
        warn(say ? std::move(say) : [](const std::string&) {}),
        describer(extractor, options),
        has_map(store != nullptr),
        map(has_map ? std::move(store) : temporary_map(fingerprint_of(extractor, options))),
        acceptance(extractor, options, *map, warn),
        entries(extractor, options, *map, !has_map, acceptance, warn) {}

  std::vector<int64_t> add(std::span<const Description> scans, std::vector<MapEntry> about,
                           Claim* claim) {
    for (size_t i = 0; i < scans.size(); ++i) {
      if (!scans[i].described())
        throw UsageError("a scan that was not described cannot be added: " + scans[i].error);
      entries.check_feature(scans[i]);
      about[i].feature = scans[i].feature;
    }
    return entries.add(std::move(about), claim);
  }
};

PlaceRecognizer::PlaceRecognizer(FeatureExtractor extractor, const RecognizerOptions& options,
                                 std::unique_ptr<MapStore>&& map, const MapStore::Warn& warn) {
  if (options.warmup < 2)
    throw UsageError(str("warm-up: expected at least 2 entries, found ", options.warmup));
  if (options.k < 1) throw UsageError("k: expected at least 1, found ", options.k);
  if (options.hnsw_candidates < 0)
    throw UsageError(str("HNSW candidates: expected at least 0, found ", options.hnsw_candidates));
  if (options.hnsw_candidates > 0) {  // fail now, not when the warm-up ends
    if (!optional_library("FAISS").built_in) built_without("candidates of a large map", "FAISS");
    if (extractor.comparison.similarity)
      throw UsageError("HNSW candidates: only for features compared by cosine, found '",
                       extractor.name, "'");
  }
  check_threshold(options.threshold);
  if (!(options.target_precision > 0 && options.target_precision < 1))
    throw UsageError(
        str("precision: expected more than 0 and less than 1, found ", options.target_precision));
  if (map) must_match("the map", map->fingerprint(), fingerprint_of(extractor, options));
  impl_ = std::make_unique<Impl>(std::move(extractor), options, std::move(map), warn);
}

PlaceRecognizer::~PlaceRecognizer() = default;

MapFingerprint PlaceRecognizer::fingerprint_of(const FeatureExtractor& extractor,
                                               const RecognizerOptions& options) {
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
  if (options.local_map != 0 && !(options.local_map >= 1 && options.local_map <= 200))
    throw UsageError("local map: expected 1 to 200 m, found ", options.local_map);
  if (options.local_map != 0) fingerprint[kLocalMap] = str(exact(options.local_map), " m");
  return fingerprint;
}

double PlaceRecognizer::local_map_of(const MapFingerprint& fingerprint) {
  double meters = 0;
  if (const auto entry = fingerprint.find(kLocalMap); entry != fingerprint.end())
    std::from_chars(entry->second.data(), entry->second.data() + entry->second.size(), meters);
  return meters;
}

Description PlaceRecognizer::describe(const PointsView& points) const {
  return impl_->describer.describe(points);
}

int64_t PlaceRecognizer::add(const Description& scan, MapEntry about) {
  std::vector<MapEntry> one;
  one.push_back(std::move(about));
  const std::unique_lock lock(impl_->mutex);
  const std::vector<int64_t> ids = impl_->add({&scan, 1}, std::move(one), nullptr);
  if (const auto index = impl_->entries.find(ids.front())) return *index;
  throw InputError("entry ", ids.front(), " was added to the map, but cannot be read from it");
}

void PlaceRecognizer::add(std::span<const Description> scans, std::vector<MapEntry> about,
                          Claim* claim) {
  if (scans.size() != about.size())
    throw UsageError("add(): ", scans.size(), " scans and ", about.size(), " entries");
  const std::unique_lock lock(impl_->mutex);
  impl_->add(scans, std::move(about), claim);
}

std::optional<Loop> PlaceRecognizer::query(const Description& scan,
                                           std::span<const int64_t> without) const {
  const std::shared_lock lock(impl_->mutex);
  if (!scan.described()) return std::nullopt;
  const KnownEntries& entries = impl_->entries;
  const Match match = entries.best(scan, without);
  if (match.ranks.empty()) return std::nullopt;
  const int64_t index = match.ranks.front();
  const MapEntry& entry = entries.at(index);
  Loop loop{.index = index,
            .id = entry.id,
            .drive = entry.drive,
            .frame = entry.frame,
            .time = entry.time,
            .pose = entry.pose,
            .similarity = match.similarities.front(),
            .kth_similarity = match.similarities.back(),
            .score = match.score,
            .probability = {},
            .relative_yaw = match.relative_yaw,
            .ambiguous = entries.is_ambiguous(index)};
  impl_->acceptance.decide(entries.distinct(), loop);
  return loop;
}

int64_t PlaceRecognizer::remove(std::span<const int64_t> indices) {
  const std::unique_lock lock(impl_->mutex);
  return impl_->entries.remove(indices);
}

int64_t PlaceRecognizer::size() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.size();
}

std::set<std::string> PlaceRecognizer::drives() const {
  const std::shared_lock lock(impl_->mutex);
  std::set<std::string> names;
  for (int64_t i = 0; i < impl_->entries.size(); ++i) names.insert(impl_->entries.at(i).drive);
  return names;
}

std::map<int64_t, int64_t> PlaceRecognizer::entries_of(const std::string& drive) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.entries_of(drive);
}

std::vector<int64_t> PlaceRecognizer::around(int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.around(index);
}

std::vector<int64_t> PlaceRecognizer::near(int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.near(index);
}

bool PlaceRecognizer::reserve_drive(const std::string& drive, const std::string& content) {
  const std::unique_lock lock(impl_->mutex);
  return impl_->map->reserve_drive(drive, content);
}

std::optional<double> PlaceRecognizer::time(int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.at(index).time;
}

const Eigen::Isometry3d& PlaceRecognizer::mount() const {
  return impl_->options.mount;
}

bool PlaceRecognizer::has_map() const {
  return impl_->has_map;
}

bool PlaceRecognizer::is_warmed_up() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.is_complete();
}

bool PlaceRecognizer::estimates_yaw() const {
  return static_cast<bool>(impl_->extractor.comparison.relative_yaw);
}

std::string PlaceRecognizer::cloud(int64_t index) const {
  const std::unique_lock lock(impl_->mutex);  // exclusive, because MapStore is not thread-safe
  return impl_->map->cloud(impl_->entries.at(index).id);
}

double PlaceRecognizer::similarity(const Description& scan, int64_t index) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->entries.similarity(scan, index);
}

std::optional<double> PlaceRecognizer::threshold() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->acceptance.threshold();
}

Score PlaceRecognizer::score() const {
  return impl_->acceptance.score();
}

std::optional<Calibration> PlaceRecognizer::verified_calibration() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->acceptance.verified_calibration();
}

std::optional<Calibration> PlaceRecognizer::calibration() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->acceptance.calibration();
}

bool PlaceRecognizer::is_calibrated() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->acceptance.is_own();
}

double PlaceRecognizer::local_map() const {
  return impl_->options.local_map;
}

void PlaceRecognizer::refresh() {
  const std::unique_lock lock(impl_->mutex);
  impl_->entries.load_updates();
}

void PlaceRecognizer::refresh_if_updated() {
  const std::unique_lock lock(impl_->mutex);
  if (impl_->entries.has_updates()) impl_->entries.load_updates();
}

void PlaceRecognizer::calibrate(double threshold) {
  const std::unique_lock lock(impl_->mutex);
  impl_->acceptance.calibrate(threshold);
}

void PlaceRecognizer::calibrate(const Calibration& calibration) {
  const std::unique_lock lock(impl_->mutex);
  impl_->acceptance.calibrate(calibration);
}

}  // namespace revisit
