#include "revisit/maps/place_recognizer.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <map>
#include <mutex>
#include <shared_mutex>
#include <thread>
#include <utility>

#include "first_stretch.h"
#include "identity.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/large_maps.h"
#include "revisit/recognition/mount.h"
#include "revisit/recognition/optional_library.h"
#include "revisit/recognition/place_index.h"
#include "spilled_clouds.h"
#include "stretches.h"

namespace revisit::pipeline {
namespace {

/// To be raised with every change after which the same scan has another descriptor.
constexpr int kRecognizerVersion = 2;

/// What is learnt and compared is made of sums of products of a few such numbers, which floats
/// hold.
constexpr float kLargest = 1e9F;
constexpr const char* kTooLarge = "numbers that are not finite, or above 1e9";
bool can_be_used(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float v) { return std::abs(v) <= kLargest; });
}

/// Of a feature that learns nothing: it is the descriptor.
Basis as_it_is(const FeatureExtractor& extractor) {
  Basis basis;
  basis.dim = extractor.dim;
  basis.describe = [](std::span<const float> feature, std::span<float> descriptor) {
    std::ranges::copy(feature, descriptor.begin());
  };
  basis.comparison = extractor.comparison;
  return basis;
}

/// A threshold as a map keeps it: a number, and behind it the score when that is not one of those
/// that older programs had.
std::string threshold_text(double value, Score score) {
  return score == Score::kDistinctMargin ? str(exact(value), " ", name_of(score)) : exact(value);
}
/// Of a map, which may be a stranger's; nothing when it is for another score.
std::optional<double> parse_threshold(const std::string& text, Score score) {
  double value = 0;
  const char* const end = text.data() + text.size();
  const std::from_chars_result read = std::from_chars(text.data(), end, value);
  const std::string of_score(read.ptr, end), distinct = str(" ", name_of(Score::kDistinctMargin));
  if (read.ec != std::errc() || !std::isfinite(value) ||
      (!of_score.empty() && of_score != distinct))
    throw InputError("the map's threshold: expected a number, found ", text.size(), " bytes");
  if (of_score.empty() == (score == Score::kDistinctMargin)) return std::nullopt;
  return value;
}

/// Working memory of one thread.
struct Worker {
  FeatureFunction<PointCloud> describe;
  PointCloud cloud;
};

/// Workers that no thread is using.
class Workers {
 public:
  explicit Workers(std::function<FeatureFunction<PointCloud>()> make) : make_(std::move(make)) {}
  std::unique_ptr<Worker> take() {
    const std::scoped_lock lock(mutex_);
    if (idle_.empty()) return std::make_unique<Worker>(Worker{make_(), {}});
    std::unique_ptr<Worker> worker = std::move(idle_.back());
    idle_.pop_back();
    return worker;
  }
  void give_back(std::unique_ptr<Worker> worker) {
    const std::scoped_lock lock(mutex_);
    idle_.push_back(std::move(worker));
  }

 private:
  std::function<FeatureFunction<PointCloud>()> make_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<Worker>> idle_;
};

}  // namespace

struct PlaceRecognizer::Impl {
  FeatureExtractor extractor;
  RecognizerOptions options;
  Score score;
  std::unique_ptr<MapStore> map;
  MapStore::Damaged damaged;
  Workers workers;

  // What queries read: under `mutex`.
  mutable std::shared_mutex mutex;
  std::optional<Basis> basis;       // nothing before the first place
  bool settled = false;             // the basis will not change any more
  std::vector<StoredPlace> places;  // without descriptor and feature
  std::optional<PlaceIndex> index;
  bool has_graph = false;                     // the index
  std::vector<int64_t> removed;               // positions, ascending; no query answers with them
  std::optional<FirstStretch> stretch;        // the places, while the basis is not settled
  std::optional<Stretches> stretches;         // of `index`; none where similarities do not tell
  int64_t learnt_from = 0;                    // while it is not: the basis (FirstStretch)
  MapPosition read_to;                        // of `map`
  int64_t removals_known = 0;                 // of read_to.removed
  bool is_behind = false;                     // an error has ended the reading of what is new
  std::map<std::string, std::string> values;  // what a map would keep, where there is none
  SpilledClouds clouds;                       // the same of places
  std::optional<Calibration> calibration;
  std::optional<double> threshold;
  bool other_score_said = false;

  Impl(FeatureExtractor feature, const RecognizerOptions& chosen, MapStore::Damaged say)
      : extractor(std::move(feature)),
        options(chosen),
        score(score_of(extractor, chosen)),
        damaged(say ? std::move(say) : [](const std::string&) {}),
        workers([this] { return from_scan(extractor, options.align, options.geometry); }) {
    workers.give_back(workers.take());  // what cannot be described at all is said at once
    stretch.emplace(extractor, options.first_stretch);
  }

  /// A feature that was calibrated keeps the score that it was calibrated for.
  static Score score_of(const FeatureExtractor& extractor, const RecognizerOptions& options) {
    if (options.score) return *options.score;
    if (extractor.calibration) return extractor.calibration->score;
    return extractor.comparison.same_place ? Score::kDistinctMargin : Score::kMargin;
  }

  /// To be called once, when `map` is there.
  void begin() {
    take_over_calibration();
    if (!extractor.reduce) settle(as_it_is(extractor));
    if (map) take_in_new_places();
    use_graph();
  }

  bool is_mine(const Calibration& one) const { return one.k == options.k && one.score == score; }

  /// What the map was calibrated to comes before what the feature was. What another score was
  /// calibrated to says nothing of this one.
  void take_over_calibration() {
    const auto kept = [&](const char* name) {
      return map ? map->value(name).value_or("") : values[name];
    };
    calibration = extractor.calibration;
    if (calibration && !is_mine(*calibration)) calibration.reset();
    const std::string text = kept(kThresholdValue), content = kept(kCalibrationValue);
    bool left_out = false;
    if (!content.empty()) {
      Calibration theirs = parse_calibration(content, "the map's calibration");
      left_out = !is_mine(theirs);
      if (!left_out) calibration = std::move(theirs);
    }
    threshold = options.threshold;
    if (!threshold && !text.empty()) {
      threshold = parse_threshold(text, score);
      left_out = left_out || !threshold;
    }
    if (left_out && !std::exchange(other_score_said, true))
      damaged(str("the map was calibrated for another k or score than ", options.k, " and ",
                  name_of(score), ": that is left aside, calibrate it again"));
    if (!threshold && calibration) threshold = calibration->threshold_for(options.precision);
  }

  /// Once there are descriptors that stay.
  void use_graph() {
    if (options.graph_candidates == 0 || has_graph || !settled || index->size() == 0) return;
    const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    index->choose_by(graph_of_keys(*index, threads), options.graph_candidates);
    has_graph = true;
  }

  void settle(Basis fixed) {
    basis = std::move(fixed);
    settled = true;
    begin_index();
    stretch.reset();
  }

  void begin_index() {
    index.emplace(basis->dim, basis->comparison);
    has_graph = false;
    stretches.reset();
    if (score == Score::kDistinctMargin && basis->comparison.same_place)
      stretches.emplace(*basis->comparison.same_place);
  }

  void check_position(int64_t position) const {
    if (position < 0 || position >= std::ssize(places))
      throw UsageError("no place is at position ", position, ": there are ", places.size(),
                       " places");
  }

  /// Another recogniser may have described the scan.
  void check_feature(const Description& scan) const {
    if (std::ssize(scan.feature) != extractor.dim)
      throw UsageError("a scan described by ", scan.feature.size(), " numbers; the feature '",
                       extractor.name, "' has ", extractor.dim);
    if (!can_be_used(scan.feature)) throw UsageError("a scan described by ", kTooLarge);
  }
  /// Why a place of the map, which may be a stranger's, cannot be used; "" when it can.
  std::string misfit_of(const StoredPlace& place) const {
    const bool by_feature = !settled || !place.feature.empty();
    const std::vector<float>& numbers = by_feature ? place.feature : place.descriptor;
    const int64_t expected = by_feature ? extractor.dim : basis->dim;
    std::string found;
    if (std::ssize(numbers) != expected)
      found = str(numbers.size(), " numbers, expected ", expected);
    else if (!can_be_used(numbers))
      found = kTooLarge;
    if (found.empty()) return "";
    return str("place ", place.id, " is left out: its ", by_feature ? "feature" : "descriptor",
               " has ", found);
  }

  std::vector<float> descriptor_of(std::span<const float> feature) const {
    std::vector<float> descriptor(static_cast<size_t>(basis->dim));
    basis->describe(feature, descriptor);
    return descriptor;
  }

  /// After places came, one or many, while the basis is not settled: it is learnt again whenever
  /// the distinct ones have doubled, and when they end the stretch.
  void learn_in_time() {
    if (!settled && stretch->features().n > 0) {
      const Basis& learnt = stretch->basis();
      if (learnt_from != stretch->learnt_from()) {
        basis = learnt;
        begin_index();
        learnt_from = stretch->learnt_from();
      }
      for (int64_t i = index->size(); i < stretch->features().n; ++i)
        index->add(descriptor_of(stretch->features().row(i)));
    }
    if (stretches) stretches->add(places, *index);
  }

  /// Without its numbers, which the index has: clear() would keep their memory.
  void know(StoredPlace place) {
    std::vector<float>().swap(place.descriptor);
    std::vector<float>().swap(place.feature);
    std::string().swap(place.cloud);
    places.push_back(std::move(place));
  }

  /// Takes the basis that the map has; the places known keep their positions.
  void look_for_a_basis() {
    const auto content = map->value(kBasisValue);
    if (!content) return;
    Basis theirs = extractor.open_basis(*content);
    const FirstStretch known = std::move(*stretch);
    settle(std::move(theirs));
    for (int64_t i = 0; i < known.features().n; ++i)
      index->add(descriptor_of(known.features().row(i)));
  }

  /// learn_in_time() is to follow.
  void take_in(StoredPlace place) {
    if (const std::string misfit = misfit_of(place); !misfit.empty()) return damaged(misfit);
    if (!settled) {
      stretch->add(place.feature);
    } else if (place.feature.empty()) {
      index->add(place.descriptor);
    } else {  // it was read before there was a basis
      index->add(descriptor_of(place.feature));
    }
    know(std::move(place));
  }

  /// Places of these ids that are known. They keep their positions, which callers hold.
  void take_out(std::span<const int64_t> ids) {
    for (const int64_t id : ids) {
      const auto found = std::ranges::lower_bound(places, id, {}, &StoredPlace::id);
      if (found != places.end() && found->id == id) take_out(found - places.begin());
    }
  }
  /// Whether it was there until now.
  bool take_out(int64_t position) {
    const auto at = std::ranges::lower_bound(removed, position);
    if (at != removed.end() && *at == position) return false;
    removed.insert(at, position);
    return true;
  }

  /// What was taken in before an error is not read again; the rest is, the next time.
  void take_in_new_places() {
    is_behind = true;
    read_new_places();
    learn_in_time();
    if (read_to.removed > removals_known) take_out(map->removed(removals_known));
    removals_known = read_to.removed;
    is_behind = false;
  }

  void read_new_places() {
    if (!settled) look_for_a_basis();
    take_over_calibration();
    if (settled) {
      const auto take = [&](StoredPlace&& place) {
        const int64_t id = place.id;
        take_in(std::move(place));
        read_to.last = id;
      };
      read_to = map->read(read_to.last, take, damaged);
      return;
    }
    std::vector<StoredPlace> places_read;
    const MapPosition position = map->read(
        read_to.last, [&](StoredPlace&& place) { places_read.push_back(std::move(place)); },
        damaged);
    look_for_a_basis();  // another may have settled it meanwhile: then these have no features
    read_to = position;
    for (StoredPlace& place : places_read) take_in(std::move(place));
  }

  /// Keeps the places, which have their features, in the map and takes them in, behind those that
  /// others added before them. Returns their ids.
  std::vector<int64_t> add_to_map(std::vector<StoredPlace> places_to_add, Claim* claim) {
    std::vector<std::vector<float>> features_to_add;
    for (StoredPlace& place : places_to_add)
      features_to_add.push_back(std::exchange(place.feature, {}));
    std::vector<int64_t> ids;
    while (true) {
      for (size_t i = 0; i < places_to_add.size(); ++i) {
        StoredPlace& place = places_to_add[i];
        place.feature = settled ? std::vector<float>() : features_to_add[i];
        place.descriptor = settled ? descriptor_of(features_to_add[i]) : features_to_add[i];
      }
      ids = claim != nullptr ? claim->add(places_to_add, read_to.revision)
                             : map->add(places_to_add, read_to.revision);
      if (ids.size() == places_to_add.size()) break;
      take_in_new_places();  // another has settled the basis
    }
    if (ids.empty()) return ids;
    if (ids.front() == read_to.last + 1) {
      read_to.last = ids.back();
      for (size_t i = 0; i < ids.size(); ++i) {
        places_to_add[i].id = ids[i];
        take_in(std::move(places_to_add[i]));
      }
      learn_in_time();
    } else {
      take_in_new_places();
    }
    return ids;
  }

  /// Adds scans and returns their ids, none without a map.
  std::vector<int64_t> add(std::span<const Description> scans, std::vector<StoredPlace> about,
                           Claim* claim) {
    for (size_t i = 0; i < scans.size(); ++i) {
      if (!scans[i].described())
        throw UsageError("a scan that was not described cannot be added: " + scans[i].why_not);
      check_feature(scans[i]);
      about[i].feature = scans[i].feature;
    }
    std::vector<int64_t> ids;
    if (map) {
      ids = add_to_map(std::move(about), claim);
    } else {
      clouds.take(about);
      for (StoredPlace& place : about) take_in(std::move(place));
      learn_in_time();
    }
    end_the_stretch_in_time();
    return ids;
  }

  int64_t position_of(int64_t id) const {
    const auto found = std::ranges::lower_bound(places, id, {}, &StoredPlace::id);
    if (found == places.end() || found->id != id)
      throw InputError("place ", id, " was added to the map, but cannot be read from it");
    return found - places.begin();
  }

  /// Places that were added may have made the stretch long enough: they are then described with its
  /// basis, in the map, too, by the one of those who add places that comes first. The others take
  /// its basis. It is learnt from the stretch alone: how many places were added at once, or after a
  /// kill here, changes nothing.
  void end_the_stretch() {
    learn_in_time();
    if (map) {
      const bool first = map->replace_descriptors(
          [&](const StoredPlace& place) {
            return misfit_of(place).empty() ? descriptor_of(place.feature) : place.descriptor;
          },
          {{kBasisValue, basis->content}}, read_to.revision);
      if (!first) return take_in_new_places();
      ++read_to.revision;
    }
    settled = true;
    stretch.reset();
  }

  /// The place that ends the stretch is in the map already, and known: an error must not say that
  /// it is not. The next place ends the stretch then.
  void end_the_stretch_in_time() {
    try {
      if (!settled && stretch->is_over()) end_the_stretch();
    } catch (const Error& error) {
      damaged(str("the first places are not described with their own basis yet: ", error.what()));
    }
    use_graph();
  }

  /// An empty one of the two says nothing. The threshold goes first: between the two steps it has
  /// the say, or the calibration of before has.
  void keep_calibration(const std::string& content, const std::string& text) {
    for (const auto& [name, bytes] :
         {std::pair(kThresholdValue, &text), std::pair(kCalibrationValue, &content)}) {
      if (!map)
        values[name] = *bytes;
      else if (!bytes->empty() || map->value(name))
        map->set_value(name, *bytes);
    }
    take_over_calibration();
  }
};

namespace {

void check_threshold(std::optional<double> threshold) {
  if (threshold && !std::isfinite(*threshold))
    throw UsageError("the threshold: expected a number, found ", *threshold);
}

/// All of `places` but those at some positions, which ascend.
std::vector<CandidateRange> ranges_without(const std::vector<int64_t>& left_out, int64_t places) {
  std::vector<CandidateRange> ranges;
  int64_t begin = 0;
  for (const int64_t position : left_out) {
    if (position < begin || position >= places) continue;
    if (position > begin) ranges.push_back({begin, position});
    begin = position + 1;
  }
  ranges.push_back({begin, places});
  return ranges;
}

}  // namespace

PlaceRecognizer::PlaceRecognizer(FeatureExtractor extractor, const RecognizerOptions& options,
                                 std::unique_ptr<MapStore>&& map,
                                 const MapStore::Damaged& damaged) {
  if (options.first_stretch < 2)
    throw UsageError(
        str("first stretch: expected at least 2 places, found ", options.first_stretch));
  if (options.k < 1) throw UsageError("k: expected at least 1, found ", options.k);
  if (options.graph_candidates < 0)
    throw UsageError(
        str("graph candidates: expected at least 0, found ", options.graph_candidates));
  if (options.graph_candidates > 0) {  // now, not when the first stretch ends
    need("candidates of a large map", "FAISS");
    if (extractor.comparison.similarity)
      throw UsageError("graph candidates: a graph is for features compared by cosine, found '",
                       extractor.name, "'");
  }
  check_threshold(options.threshold);
  if (!(options.precision > 0 && options.precision < 1))
    throw UsageError(
        str("precision: expected more than 0 and less than 1, found ", options.precision));
  impl_ = std::make_unique<Impl>(std::move(extractor), options, damaged);
  impl_->map = std::move(map);
  try {
    if (impl_->map)
      must_match("the map", impl_->map->identity(), identity_of(impl_->extractor, options));
    impl_->begin();
  } catch (...) {
    map = std::move(impl_->map);
    throw;
  }
}

PlaceRecognizer::~PlaceRecognizer() = default;

MapIdentity PlaceRecognizer::identity_of(const FeatureExtractor& extractor,
                                         const RecognizerOptions& options) {
  const ImageGeometry& g = options.geometry;
  return {{"recogniser", str(kRecognizerVersion)},
          {"feature", extractor.name},
          {"made by", extractor.key},
          {"numbers", str(extractor.dim)},
          {"alignment", name_of(options.align)},
          {"image", extractor.sees<RangeImage>()
                        ? str(g.width, " x ", g.height, ", ", g.elevation_bottom, " to ",
                              g.elevation_top, " deg, ", g.max_range, " m, closed ",
                              g.closing_width, " x ", g.closing_height, " deg")
                        : "none"}};
}

Description PlaceRecognizer::describe(const PointsView& points) const {
  std::unique_ptr<Worker> worker = impl_->workers.take();
  Description scan;
  copy_points(points, worker->cloud);
  transform(impl_->options.mount, worker->cloud);
  scan.feature.resize(static_cast<size_t>(impl_->extractor.dim));
  try {
    if (std::ranges::none_of(worker->cloud.points, is_return))
      throw InputError("the scan has no points");
    worker->describe(worker->cloud, scan.feature);
    if (!can_be_used(scan.feature)) throw InputError("its feature has ", kTooLarge);
  } catch (const InputError& error) {
    scan = {{}, error.what()};
  }
  impl_->workers.give_back(std::move(worker));
  return scan;
}

int64_t PlaceRecognizer::add(const Description& scan, StoredPlace about) {
  std::vector<StoredPlace> one;
  one.push_back(std::move(about));
  const std::unique_lock lock(impl_->mutex);
  const std::vector<int64_t> ids = impl_->add({&scan, 1}, std::move(one), nullptr);
  return ids.empty() ? std::ssize(impl_->places) - 1 : impl_->position_of(ids.front());
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
  const Impl& impl = *impl_;
  if (!scan.described()) return std::nullopt;
  impl.check_feature(scan);
  if (impl.places.empty() || !impl.index) return std::nullopt;
  std::vector<int64_t> left_out(without.begin(), without.end());
  std::ranges::sort(left_out);
  const auto middle = left_out.insert(left_out.end(), impl.removed.begin(), impl.removed.end());
  std::ranges::inplace_merge(left_out, middle);
  const std::vector<CandidateRange> candidates = ranges_without(left_out, impl.index->size());
  const std::vector<float> descriptor = impl.descriptor_of(scan.feature);
  const Match match =
      impl.index->best(descriptor, candidates, {.k = impl.options.k, .score = impl.score});
  if (match.ranks.empty()) return std::nullopt;
  const int64_t position = match.ranks.front();
  const StoredPlace& place = impl.places[static_cast<size_t>(position)];
  Loop loop{position,
            place.id,
            place.drive,
            place.frame,
            place.time,
            place.pose,
            match.similarities.front(),
            match.similarities.back(),
            match.score,
            {},
            match.turn,
            impl.stretches && impl.stretches->is_long(position)};
  // Of n distinct places none looks like another: n / (n + 1) that the next one does not (Laplace's
  // rule of succession).
  const auto n =
      static_cast<double>(impl.stretch ? impl.stretch->distinct() : impl.options.first_stretch);
  const double most = n / (n + 1);
  if (impl.calibration)
    loop.probability = std::min(most, impl.calibration->probability(loop.score));
  loop.accepted = !loop.ambiguous && impl.threshold && loop.score >= *impl.threshold &&
                  (impl.options.threshold || !impl.stretch || most >= impl.options.precision);
  return loop;
}

int64_t PlaceRecognizer::remove(std::span<const int64_t> positions) {
  const std::unique_lock lock(impl_->mutex);
  Impl& impl = *impl_;
  std::vector<int64_t> ids;
  for (const int64_t position : positions) {
    impl.check_position(position);
    ids.push_back(impl.places[static_cast<size_t>(position)].id);
  }
  if (impl.map) impl.map->remove(ids);
  return std::ranges::count_if(positions,
                               [&](int64_t position) { return impl.take_out(position); });
}

int64_t PlaceRecognizer::size() const {
  const std::shared_lock lock(impl_->mutex);
  return static_cast<int64_t>(impl_->places.size());
}

std::map<int64_t, int64_t> PlaceRecognizer::places_of(const std::string& drive) const {
  const std::shared_lock lock(impl_->mutex);
  std::map<int64_t, int64_t> frames;
  for (int64_t position = 0; position < std::ssize(impl_->places); ++position) {
    const StoredPlace& place = impl_->places[static_cast<size_t>(position)];
    if (place.drive == drive && !std::ranges::binary_search(impl_->removed, position))
      frames[place.frame] = position;
  }
  return frames;
}

bool PlaceRecognizer::reserve_drive(const std::string& drive, const std::string& content) {
  const std::unique_lock lock(impl_->mutex);
  return !impl_->map || impl_->map->reserve_drive(drive, content);
}

const Eigen::Isometry3d& PlaceRecognizer::mount() const {
  return impl_->options.mount;
}

bool PlaceRecognizer::has_map() const {
  return impl_->map != nullptr;
}

bool PlaceRecognizer::finds_heading() const {
  return static_cast<bool>(impl_->extractor.comparison.turn);
}

std::string PlaceRecognizer::cloud(int64_t position) const {
  const std::unique_lock lock(impl_->mutex);  // of the map, which one thread asks
  impl_->check_position(position);
  const StoredPlace& place = impl_->places[static_cast<size_t>(position)];
  return impl_->map ? impl_->map->cloud(place.id) : impl_->clouds.of(position);
}

double PlaceRecognizer::similarity(const Description& scan, int64_t position) const {
  const std::shared_lock lock(impl_->mutex);
  impl_->check_feature(scan);
  impl_->check_position(position);
  return impl_->index->similarity(impl_->descriptor_of(scan.feature), position);
}

std::optional<double> PlaceRecognizer::threshold() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->threshold;
}

Score PlaceRecognizer::score() const {
  return impl_->score;
}

std::optional<Calibration> PlaceRecognizer::calibration() const {
  const std::shared_lock lock(impl_->mutex);
  return impl_->calibration;
}

void PlaceRecognizer::refresh() {
  const std::unique_lock lock(impl_->mutex);
  if (impl_->map) impl_->take_in_new_places();
}

void PlaceRecognizer::refresh_on_news() {
  const std::unique_lock lock(impl_->mutex);
  if (impl_->map && (impl_->is_behind || impl_->map->has_news())) impl_->take_in_new_places();
}

void PlaceRecognizer::calibrate(double threshold) {
  check_threshold(threshold);
  const std::unique_lock lock(impl_->mutex);
  impl_->keep_calibration({}, threshold_text(threshold, impl_->score));
}

void PlaceRecognizer::calibrate(const Calibration& calibration) {
  const std::string content = calibration_content(calibration);
  try {
    parse_calibration(content, "calibrate()");
  } catch (const InputError& error) {
    throw UsageError(error.what());
  }
  const std::unique_lock lock(impl_->mutex);
  if (!impl_->is_mine(calibration))
    throw UsageError("the calibration is for k = ", calibration.k, " and the score ",
                     name_of(calibration.score), ", RecognizerOptions has k = ", impl_->options.k,
                     " and ", name_of(impl_->score));
  impl_->keep_calibration(content, {});
}

}  // namespace revisit::pipeline
