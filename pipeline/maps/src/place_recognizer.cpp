#include "revisit/maps/place_recognizer.h"

#include <algorithm>
#include <charconv>
#include <mutex>
#include <shared_mutex>
#include <utility>

#include "acceptance.h"
#include "identity.h"
#include "known_places.h"
#include "map_follower.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/recognition/optional_library.h"
#include "scan_describer.h"
#include "spilled_clouds.h"

namespace revisit {
namespace {

/// Must be raised with every change of the descriptor of a given scan.
constexpr int kRecognizerVersion = 2;

constexpr const char* kLocalMap = "local map";

}  // namespace

struct PlaceRecognizer::Impl {
  const FeatureExtractor extractor;
  const RecognizerOptions options;
  const MapStore::Warn warn;
  const ScanDescriber describer;
  std::unique_ptr<MapStore> map;

  mutable std::shared_mutex mutex;  // guards the following members and the map
  Acceptance acceptance;
  KnownPlaces places;
  std::optional<MapFollower> follower;
  SpilledClouds clouds;

  Impl(FeatureExtractor feature, const RecognizerOptions& chosen, MapStore* map_to_be,
       MapStore::Warn say)
      : extractor(std::move(feature)),
        options(chosen),
        warn(say ? std::move(say) : [](const std::string&) {}),
        describer(extractor, options),
        acceptance(extractor, options, map_to_be, warn),
        places(extractor, options, acceptance.score()) {
    if (map_to_be != nullptr) follower.emplace(*map_to_be, extractor, places, acceptance, warn);
  }

  std::vector<int64_t> add(std::span<const Description> scans, std::vector<StoredPlace> about,
                           Claim* claim) {
    for (size_t i = 0; i < scans.size(); ++i) {
      if (!scans[i].described())
        throw UsageError("a scan that was not described cannot be added: " + scans[i].error);
      places.check_feature(scans[i]);
      about[i].feature = scans[i].feature;
    }
    std::vector<int64_t> ids;
    if (follower) {
      ids = follower->add(std::move(about), claim);
    } else {
      clouds.take(about);
      for (StoredPlace& place : about) places.add(std::move(place));
      places.update();
    }
    settle_in_time();
    return ids;
  }

  /// The final projection depends on the warm-up alone, not on batches or kills. Errors are only
  /// reported, because the entry is already in the map and loaded; the next add() tries again.
  void settle_in_time() {
    if (!places.is_complete()) return;
    try {
      places.update();
      follower ? follower->settle() : places.settle();
    } catch (const Error& error) {
      warn(str("the warm-up could not be completed and is tried again: ", error.what()));
    }
  }
};

PlaceRecognizer::PlaceRecognizer(FeatureExtractor extractor, const RecognizerOptions& options,
                                 std::unique_ptr<MapStore>&& map, const MapStore::Warn& warn) {
  if (options.warmup < 2)
    throw UsageError(str("warm-up: expected at least 2 places, found ", options.warmup));
  if (options.k < 1) throw UsageError("k: expected at least 1, found ", options.k);
  if (options.hnsw_candidates < 0)
    throw UsageError(str("HNSW candidates: expected at least 0, found ", options.hnsw_candidates));
  if (options.hnsw_candidates > 0) {  // fail now, not when the warm-up ends
    need("candidates of a large map", "FAISS");
    if (extractor.comparison.similarity)
      throw UsageError("HNSW candidates: only for features compared by cosine, found '",
                       extractor.name, "'");
  }
  check_threshold(options.threshold);
  if (!(options.target_precision > 0 && options.target_precision < 1))
    throw UsageError(
        str("precision: expected more than 0 and less than 1, found ", options.target_precision));
  if (map) must_match("the map", map->fingerprint(), fingerprint_of(extractor, options));
  impl_ = std::make_unique<Impl>(std::move(extractor), options, map.get(), warn);
  impl_->map = std::move(map);
}

PlaceRecognizer::~PlaceRecognizer() = default;

MapFingerprint PlaceRecognizer::fingerprint_of(const FeatureExtractor& extractor,
                                               const RecognizerOptions& options) {
  const ImageGeometry& g = options.geometry;
  MapFingerprint identity{
      {"recogniser", str(kRecognizerVersion)},
      {"feature", extractor.name},
      {"made by", extractor.key},
      {"numbers", str(extractor.dim)},
      {"alignment", name_of(options.align)},
      {"image", extractor.sees<RangeImage>()
                    ? str(g.width, " x ", g.height, ", ", g.elevation_bottom, " to ",
                          g.elevation_top, " deg, ", g.max_range, " m, closed ", g.closing_width,
                          " x ", g.closing_height, " deg")
                    : "none"}};
  // Omitted if 0, because older maps have no such entry.
  if (options.local_map != 0 && !(options.local_map >= 1 && options.local_map <= 200))
    throw UsageError("local map: expected 1 to 200 m, found ", options.local_map);
  if (options.local_map != 0) identity[kLocalMap] = str(exact(options.local_map), " m");
  return identity;
}

double PlaceRecognizer::local_map_of(const MapFingerprint& identity) {
  double meters = 0;
  if (const auto entry = identity.find(kLocalMap); entry != identity.end())
    std::from_chars(entry->second.data(), entry->second.data() + entry->second.size(), meters);
  return meters;
}

Description PlaceRecognizer::describe(const PointsView& points) const {
  return impl_->describer.describe(points);
}

int64_t PlaceRecognizer::add(const Description& scan, StoredPlace about) {
  std::vector<StoredPlace> one;
  one.push_back(std::move(about));
  const std::unique_lock lock(impl_->mutex);
  const std::vector<int64_t> ids = impl_->add({&scan, 1}, std::move(one), nullptr);
  if (ids.empty()) return impl_->places.size() - 1;
  if (const auto position = impl_->places.find(ids.front())) return *position;
  throw InputError("place ", ids.front(), " was added to the map, but cannot be read from it");
}

void PlaceRecognizer::add(std::span<const Description> scans, std::vector<StoredPlace> about,
                          Claim* claim) {
  if (scans.size() != about.size())
    throw UsageError("add(): ", scans.size(), " scans and ", about.size(), " places");
  const std::unique_lock lock(impl_->mutex);
  impl_->add(scans, std::move(about), claim);
}

std::optional<Loop> PlaceRecognizer::query(const Description& scan,
                                           std::span<const int64_t> without) const {
  const std::shared_lock lock(impl_->mutex);
  if (!scan.described()) return std::nullopt;
  const KnownPlaces& places = impl_->places;
  const Match match = places.best(scan, without);
  if (match.ranks.empty()) return std::nullopt;
  const int64_t position = match.ranks.front();
  const StoredPlace& place = places.at(position);
  Loop loop{.index = position,
            .id = place.id,
            .drive = place.drive,
            .frame = place.frame,
            .time = place.time,
            .pose = place.pose,
            .similarity = match.similarities.front(),
            .kth_similarity = match.similarities.back(),
            .score = match.score,
            .probability = {},
            .relative_yaw = match.relative_yaw,
            .ambiguous = places.is_ambiguous(position)};
  impl_->acceptance.decide(places.distinct(), loop);
  return loop;
}

int64_t PlaceRecognizer::remove(std::span<const int64_t> positions) {
  const std::unique_lock lock(impl_->mutex);
  std::vector<int64_t> ids;
  for (const int64_t position : positions) ids.push_back(impl_->places.at(position).id);
  if (impl_->map) impl_->map->remove(ids);
  return std::ranges::count_if(positions,
                               [&](int64_t position) { return impl_->places.remove(position); });
}

int64_t PlaceRecognizer::size() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.size();
}

std::set<std::string> PlaceRecognizer::drives() const {
  const std::shared_lock lock(impl_->mutex);
  std::set<std::string> names;
  for (int64_t i = 0; i < impl_->places.size(); ++i) names.insert(impl_->places.at(i).drive);
  return names;
}

std::map<int64_t, int64_t> PlaceRecognizer::places_of(const std::string& drive) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.places_of(drive);
}

std::vector<int64_t> PlaceRecognizer::around(int64_t position) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.around(position);
}

std::vector<int64_t> PlaceRecognizer::near(int64_t position) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.near(position);
}

bool PlaceRecognizer::reserve_drive(const std::string& drive, const std::string& content) {
  const std::unique_lock lock(impl_->mutex);
  return !impl_->map || impl_->map->reserve_drive(drive, content);
}

std::optional<double> PlaceRecognizer::time(int64_t position) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.at(position).time;
}

const Eigen::Isometry3d& PlaceRecognizer::mount() const {
  return impl_->options.mount;
}

bool PlaceRecognizer::has_map() const {
  return impl_->map != nullptr;
}

bool PlaceRecognizer::is_warmed_up() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.is_final();
}

bool PlaceRecognizer::estimates_yaw() const {
  return static_cast<bool>(impl_->extractor.comparison.relative_yaw);
}

std::string PlaceRecognizer::cloud(int64_t position) const {
  const std::unique_lock lock(impl_->mutex);  // exclusive, because MapStore is not thread-safe
  const StoredPlace& place = impl_->places.at(position);
  return impl_->map ? impl_->map->cloud(place.id) : impl_->clouds.of(position);
}

double PlaceRecognizer::similarity(const Description& scan, int64_t position) const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->places.similarity(scan, position);
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
  if (impl_->follower) impl_->follower->load_updates();
}

void PlaceRecognizer::refresh_if_updated() {
  const std::unique_lock lock(impl_->mutex);
  if (impl_->follower && impl_->follower->has_updates()) impl_->follower->load_updates();
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
