#include "known_entries.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "map_format.h"
#include "revisit/base/error.h"
#include "revisit/base/text.h"

namespace revisit {
namespace {

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

KnownEntries::KnownEntries(const FeatureExtractor& extractor, const RecognizerOptions& options,
                           Score score)
    : extractor_(extractor), options_(options), score_(score) {
  warm_up_.emplace(extractor, options.warmup);
  if (!extractor.fit_projection) set_projection(unchanged_projection(extractor));
}

std::string KnownEntries::misfit_of(const MapEntry& entry) const {
  const bool by_feature = !is_final() || !entry.feature.empty();
  const std::vector<float>& numbers = by_feature ? entry.feature : entry.descriptor;
  const int64_t expected = by_feature ? extractor_.dim : projection_->dim;
  std::string found;
  if (std::ssize(numbers) != expected)
    found = str(numbers.size(), " dimensions, expected ", expected);
  else if (!is_usable(numbers))
    found = kTooLarge;
  if (found.empty()) return "";
  return str("entry ", entry.id, " is skipped: its ", by_feature ? "feature" : "descriptor",
             " has ", found);
}

/// The index holds the values; swap() frees their memory, unlike clear().
void KnownEntries::add(MapEntry entry) {
  if (warm_up_)
    warm_up_->add(entry.feature);
  else if (entry.feature.empty())
    index_->add(entry.descriptor);
  else  // loaded before the projection was final
    index_->add(descriptor_of(entry.feature));
  std::vector<float>().swap(entry.descriptor);
  std::vector<float>().swap(entry.feature);
  std::string().swap(entry.cloud);
  entries_.push_back(std::move(entry));
}

void KnownEntries::update() {
  if (entries_.empty()) return;
  if (warm_up_) {
    const Projection& estimated = warm_up_->projection();
    if (fitted_to_ != warm_up_->estimated_from()) {
      projection_ = estimated;
      begin_index();
      fitted_to_ = warm_up_->estimated_from();
    }
    for (int64_t i = index_->size(); i < size(); ++i)
      index_->add(descriptor_of(warm_up_->features().row(i)));
  }
  if (stretches_) stretches_->add(entries_, *index_);
  use_graph();
}

void KnownEntries::begin_index() {
  index_.emplace(projection_->dim, projection_->comparison);
  has_graph_ = false;
  stretches_.reset();
  if (score_ == Score::kDistinctMargin && projection_->comparison.same_place)
    stretches_.emplace(*projection_->comparison.same_place);
}

void KnownEntries::use_graph() {
  if (options_.hnsw_candidates == 0 || has_graph_ || !is_final()) return;
  const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  index_->set_candidate_source(make_hnsw_source(*index_, threads), options_.hnsw_candidates);
  has_graph_ = true;
}

void KnownEntries::remove_ids(std::span<const int64_t> ids) {
  for (const int64_t id : ids)
    if (const auto index = find(id)) remove(*index);
}

bool KnownEntries::remove(int64_t index) {
  const auto at = std::ranges::lower_bound(removed_, index);
  if (at != removed_.end() && *at == index) return false;
  removed_.insert(at, index);
  return true;
}

void KnownEntries::set_projection(Projection projection) {
  projection_ = std::move(projection);
  begin_index();
  for (int64_t i = 0; i < size(); ++i) index_->add(descriptor_of(warm_up_->features().row(i)));
  warm_up_.reset();
}

void KnownEntries::end_warm_up() {
  warm_up_.reset();
  use_graph();
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

std::map<int64_t, int64_t> KnownEntries::entries_of(const std::string& drive) const {
  std::map<int64_t, int64_t> frames;
  for (int64_t index = 0; index < size(); ++index) {
    const MapEntry& entry = entries_[static_cast<size_t>(index)];
    if (entry.drive == drive && !std::ranges::binary_search(removed_, index))
      frames[entry.frame] = index;
  }
  return frames;
}

bool KnownEntries::is_ambiguous(int64_t index) const {
  return stretches_ && stretches_->is_long(index);
}

std::vector<int64_t> KnownEntries::around(int64_t index) const {
  at(index);
  if (!stretches_) return {index};
  const std::span<const int64_t> entries = stretches_->around(index);
  return {entries.begin(), entries.end()};
}

std::vector<int64_t> KnownEntries::near(int64_t index) const {
  at(index);
  return stretches_ ? stretches_->near(index) : std::vector<int64_t>{index};
}

void KnownEntries::check_feature(const Description& scan) const {
  if (std::ssize(scan.feature) != extractor_.dim)
    throw UsageError("the scan's feature has ", scan.feature.size(), " dimensions; the feature '",
                     extractor_.name, "' has ", extractor_.dim);
  if (!is_usable(scan.feature)) throw UsageError("the scan's feature has ", kTooLarge);
}

Match KnownEntries::best(const Description& scan, std::span<const int64_t> without) const {
  check_feature(scan);
  if (entries_.empty() || !index_) return {};
  std::vector<int64_t> excluded(without.begin(), without.end());
  std::ranges::sort(excluded);
  const auto middle = excluded.insert(excluded.end(), removed_.begin(), removed_.end());
  std::ranges::inplace_merge(excluded, middle);
  return index_->best(descriptor_of(scan.feature), ranges_without(excluded, index_->size()),
                      {.k = options_.k, .score = score_});
}

double KnownEntries::similarity(const Description& scan, int64_t index) const {
  check_feature(scan);
  at(index);
  return index_->similarity(descriptor_of(scan.feature), index);
}

}  // namespace revisit
