#include "known_entries.h"

#include <algorithm>
#include <bit>
#include <thread>
#include <utility>

#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

/// The warm-up ends after this many entries for each distinct one that it should have.
constexpr int64_t kMaxEntriesPerDistinct = 5;
/// Limit of the features of a warm-up, 1 GB: deflated ones of an untrusted file are far smaller.
constexpr int64_t kMostNumbers = int64_t{1} << 28;

Projection unchanged_projection(const FeatureExtractor& extractor) {
  Projection projection;
  projection.dim = extractor.dim;
  projection.describe = [](std::span<const float> feature, std::span<float> descriptor) {
    std::ranges::copy(feature, descriptor.begin());
  };
  projection.comparison = extractor.comparison;
  return projection;
}

std::vector<CandidateRange> ranges_without(const std::vector<int64_t>& excluded, int64_t entries) {
  std::vector<CandidateRange> ranges;
  int64_t begin = 0;
  for (const int64_t index : excluded) {
    if (index < begin || index >= entries) continue;
    if (index > begin) ranges.push_back({begin, index});
    begin = index + 1;
  }
  ranges.push_back({begin, entries});
  return ranges;
}

}  // namespace

KnownEntries::KnownEntries(const FeatureExtractor& extractor, const MapOptions& options,
                           MapStore& map, bool is_temporary, const MapStore::Warn& warn)
    : extractor_(extractor),
      options_(options),
      map_(map),
      is_temporary_(is_temporary),
      warn_(warn) {
  features_.d = extractor.dim;
  if (!extractor.fit_projection) complete(unchanged_projection(extractor));
  load_updates();
}

void KnownEntries::load_updates() {
  is_behind_ = true;
  read_new_entries();
  update();
  if (read_to_.removed > removals_known_)
    for (const int64_t id : map_.removed(removals_known_))
      if (const auto index = find(id)) remove_index(*index);
  removals_known_ = read_to_.removed;
  is_behind_ = false;
  ++loadings_;
}

void KnownEntries::read_new_entries() {
  look_for_projection();
  if (is_complete()) {
    const auto take = [&](MapEntry&& entry) {
      const int64_t id = entry.id;
      take_in(std::move(entry));
      read_to_.last = id;
    };
    read_to_ = map_.read(read_to_.last, take, warn_);
    return;
  }
  std::vector<MapEntry> entries_read;
  const auto keep = [&, most = kMostNumbers / extractor_.dim](MapEntry&& entry) {
    if (size() + std::ssize(entries_read) == most)
      throw InputError(map_.name(), ": its warm-up is not complete and has more than ", most,
                       " entries; build the map again with a smaller warm-up");
    entries_read.push_back(std::move(entry));
  };
  const MapState state = map_.read(read_to_.last, keep, warn_);
  // Another process may have completed the warm-up meanwhile: then these have no features.
  look_for_projection();
  read_to_ = state;
  for (MapEntry& entry : entries_read) take_in(std::move(entry));
}

void KnownEntries::look_for_projection() {
  if (is_complete()) return;
  const auto content = map_.value(kProjectionValue);
  if (content) try {
      complete(extractor_.open_projection(*content));
    } catch (const InputError& error) {
      throw InputError(map_.name(), ": ", error.what());
    }
}

/// The index holds the values; swap() frees their memory, unlike clear().
void KnownEntries::take_in(MapEntry entry) {
  if (const std::string problem = problem_of(entry); !problem.empty())
    return warn_(str(map_.name(), ": entry ", entry.id, " is skipped: ", problem));
  if (!is_complete())
    collect(entry.feature);
  else if (entry.feature.empty())
    index_->add(entry.descriptor);
  else  // loaded before the projection was final
    index_->add(descriptor_of(entry.feature));
  std::vector<float>().swap(entry.descriptor);
  std::vector<float>().swap(entry.feature);
  std::string().swap(entry.cloud);
  std::vector<MapLoop>().swap(entry.loops);
  std::vector<int64_t>().swap(entry.questioned);
  entries_.push_back(std::move(entry));
}

/// Reason why an entry of a map, which may be untrusted, cannot be taken in; "" if it can.
std::string KnownEntries::problem_of(const MapEntry& entry) const {
  return misfit_of(entry, extractor_.dim,
                   is_complete() ? std::optional(projection_->dim) : std::nullopt);
}

std::vector<int64_t> KnownEntries::add(std::vector<MapEntry> entries) {
  std::vector<std::vector<float>> features;
  for (MapEntry& entry : entries) {
    // Whether an entry is read back or not, before or after the warm-up.
    if (extractor_.fit_projection) round_feature(entry.feature);
    features.push_back(std::exchange(entry.feature, {}));
  }
  std::vector<int64_t> ids;
  while (true) {
    for (size_t i = 0; i < entries.size(); ++i) {
      entries[i].feature = is_complete() ? std::vector<float>() : features[i];
      entries[i].descriptor = is_complete() ? descriptor_of(features[i]) : std::vector<float>();
    }
    ids = store(entries);
    if (ids.size() == entries.size()) break;
    load_updates();
  }
  if (!ids.empty() && ids.front() != read_to_.last + 1) {
    load_updates();
  } else {
    for (size_t i = 0; i < ids.size(); ++i) {
      entries[i].id = read_to_.last = ids[i];
      take_in(std::move(entries[i]));
    }
    update();
  }
  if (state_ == State::kProjected) store_projection();
  return ids;
}

std::vector<int64_t> KnownEntries::store(std::span<const MapEntry> entries) {
  if (!is_temporary_) return map_.add(entries, read_to_.revision);
  std::vector<MapEntry> without_values;
  for (const MapEntry& entry : entries)
    without_values.push_back({.drive = entry.drive,
                              .frame = entry.frame,
                              .time = entry.time,
                              .pose = entry.pose,
                              .cloud = entry.cloud});
  return map_.add(without_values);
}

/// If several processes do so, the others load that of the first one. Errors are only reported,
/// because the entry is already in the map and loaded; the next add() tries again.
void KnownEntries::store_projection() {
  try {
    if (!is_temporary_) {
      const bool is_first = map_.replace_descriptors(
          [&](const MapEntry& entry) {
            return problem_of(entry).empty() ? descriptor_of(entry.feature) : entry.descriptor;
          },
          {{kProjectionValue, projection_->content}}, read_to_.revision);
      if (!is_first) return load_updates();
      ++read_to_.revision;
    }
    state_ = State::kComplete;
    features_ = {};
    use_graph();
  } catch (const Error& error) {
    warn_(str("the warm-up could not be completed and is tried again: ", error.what()));
  }
}

/// During the warm-up. All features are kept, because entries between distinct ones are described
/// again, too.
void KnownEntries::collect(std::span<const float> feature) {
  features_.values.insert(features_.values.end(), feature.begin(), feature.end());
  ++features_.n;
  if (state_ == State::kProjected) return;
  if (is_distinct(feature)) distinct_.push_back(features_.n - 1);
  if (std::ssize(distinct_) == options_.warmup ||
      features_.n / kMaxEntriesPerDistinct == options_.warmup)
    state_ = State::kProjected;
}

bool KnownEntries::is_distinct(std::span<const float> feature) {
  if (distinct_.empty() || !extractor_.comparison.same_place) return true;
  estimate_projection();
  return projection_->comparison.similarity_of(descriptor_of(feature),
                                               descriptor_of(features_.row(distinct_.back()))) <
         *extractor_.comparison.same_place;
}

void KnownEntries::estimate_projection() {
  const auto n = std::ssize(distinct_);
  const int64_t from = state_ == State::kProjected
                           ? n
                           : static_cast<int64_t>(std::bit_floor(static_cast<uint64_t>(n)));
  if (from == estimated_from_) return;
  projection_ = extractor_.fit_projection(features_.rows(),
                                          std::span(distinct_).first(static_cast<size_t>(from)));
  estimated_from_ = from;
}

void KnownEntries::complete(Projection projection) {
  projection_ = std::move(projection);
  begin_index();
  for (int64_t i = 0; i < size(); ++i) index_->add(descriptor_of(features_.row(i)));
  state_ = State::kComplete;
  features_ = {};
}

/// Describes the entries that were taken in.
void KnownEntries::update() {
  if (entries_.empty()) return;
  if (!is_complete()) {
    estimate_projection();
    if (indexed_from_ != estimated_from_) begin_index();
    indexed_from_ = estimated_from_;
    for (int64_t i = index_->size(); i < size(); ++i) index_->add(descriptor_of(features_.row(i)));
  }
  if (stretches_) {
    std::vector<DriveScan> added;
    for (int64_t i = stretches_->size(); i < size(); ++i)
      added.push_back({at(i).drive, at(i).frame, at(i).pose});
    stretches_->add(added, *index_);
  }
  use_graph();
}

void KnownEntries::begin_index() {
  index_.emplace(projection_->dim, projection_->comparison);
  has_graph_ = false;
  stretches_.reset();
  if (*options_.score == Score::kDistinctMargin && projection_->comparison.same_place)
    stretches_.emplace(*projection_->comparison.same_place);
}

void KnownEntries::use_graph() {
  if (options_.hnsw_candidates == 0 || has_graph_ || !is_complete()) return;
  const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  index_->set_candidate_source(make_hnsw_source(*index_, threads), options_.hnsw_candidates);
  has_graph_ = true;
}

int64_t KnownEntries::remove(std::span<const int64_t> indices) {
  std::vector<int64_t> ids;
  for (const int64_t index : indices) ids.push_back(at(index).id);
  map_.remove(ids);
  return std::ranges::count_if(indices, [&](int64_t index) { return remove_index(index); });
}

/// Returns false if the entry was removed before.
bool KnownEntries::remove_index(int64_t index) {
  const auto at = std::ranges::lower_bound(removed_, index);
  if (at != removed_.end() && *at == index) return false;
  removed_.insert(at, index);
  return true;
}

std::vector<float> KnownEntries::descriptor_of(std::span<const float> feature) const {
  std::vector<float> descriptor(static_cast<size_t>(projection_->dim));
  projection_->describe(feature, descriptor);
  return descriptor;
}

const MapEntry& KnownEntries::at(int64_t index) const {
  if (index < 0 || index >= size())
    throw UsageError("no entry has the index ", index, ": there are ", size(), " entries");
  return entries_[static_cast<size_t>(index)];
}

std::optional<int64_t> KnownEntries::find(int64_t id) const {
  const auto found = std::ranges::lower_bound(entries_, id, {}, &MapEntry::id);
  if (found == entries_.end() || found->id != id) return std::nullopt;
  return found - entries_.begin();
}

DriveEntries KnownEntries::entries_of(const std::string& drive) const {
  DriveEntries frames;
  for (int64_t index = 0; index < size(); ++index) {
    const MapEntry& entry = entries_[static_cast<size_t>(index)];
    if (entry.drive == drive && !std::ranges::binary_search(removed_, index))
      frames[entry.frame] = index;
  }
  return frames;
}

std::set<std::string> KnownEntries::drives() const {
  std::set<std::string> names;
  for (const MapEntry& entry : entries_) names.insert(entry.drive);
  return names;
}

bool KnownEntries::is_ambiguous(int64_t index) const {
  return stretches_ && stretches_->is_long(index);
}

std::vector<int64_t> KnownEntries::around(int64_t index, bool margin) const {
  at(index);
  if (!stretches_) return {index};
  if (margin) return stretches_->near(index);
  const std::span<const int64_t> entries = stretches_->around(index);
  return {entries.begin(), entries.end()};
}

void KnownEntries::check_feature(std::span<const float> feature, const std::string& made_by) const {
  if (!made_by.empty() && made_by != extractor_.key)
    throw UsageError("the scan was described by the feature '", made_by, "', ", map_.name(),
                     " has '", extractor_.key, "'; describe the scan with this map");
  if (std::ssize(feature) != extractor_.dim)
    throw UsageError("the scan's feature has ", feature.size(), " dimensions; the feature '",
                     extractor_.name, "' has ", extractor_.dim);
  if (!is_usable(feature)) throw UsageError("the scan's feature has ", kTooLarge);
}

Match KnownEntries::best(const Description& scan, std::span<const int64_t> without) const {
  check_feature(scan.feature, scan.made_by);
  if (entries_.empty() || !index_) return {};
  std::vector<int64_t> excluded(without.begin(), without.end());
  std::ranges::sort(excluded);
  const auto middle = excluded.insert(excluded.end(), removed_.begin(), removed_.end());
  std::ranges::inplace_merge(excluded, middle);
  return index_->best(descriptor_of(scan.feature), ranges_without(excluded, index_->size()),
                      {.k = options_.k, .score = *options_.score});
}

double KnownEntries::similarity(const Description& scan, int64_t index) const {
  check_feature(scan.feature, scan.made_by);
  at(index);
  return index_->similarity(descriptor_of(scan.feature), index);
}

std::optional<double> KnownEntries::relative_yaw(const Description& scan, int64_t index) const {
  check_feature(scan.feature, scan.made_by);
  at(index);
  return index_->relative_yaw(descriptor_of(scan.feature), index);
}

}  // namespace revisit
