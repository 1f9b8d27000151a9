#include "known_places.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "revisit/base/error.h"
#include "revisit/base/text.h"
#include "revisit/maps/large_maps.h"
#include "usable_numbers.h"

namespace revisit {
namespace {

Projection identity_projection(const FeatureExtractor& extractor) {
  Projection basis;
  basis.dim = extractor.dim;
  basis.describe = [](std::span<const float> feature, std::span<float> descriptor) {
    std::ranges::copy(feature, descriptor.begin());
  };
  basis.comparison = extractor.comparison;
  return basis;
}

std::vector<CandidateRange> ranges_without(const std::vector<int64_t>& excluded, int64_t places) {
  std::vector<CandidateRange> ranges;
  int64_t begin = 0;
  for (const int64_t position : excluded) {
    if (position < begin || position >= places) continue;
    if (position > begin) ranges.push_back({begin, position});
    begin = position + 1;
  }
  ranges.push_back({begin, places});
  return ranges;
}

}  // namespace

KnownPlaces::KnownPlaces(const FeatureExtractor& extractor, const RecognizerOptions& options,
                         Score score)
    : extractor_(extractor), options_(options), score_(score) {
  first_.emplace(extractor, options.warmup);
  if (!extractor.fit_projection) settle(identity_projection(extractor));
}

std::string KnownPlaces::misfit_of(const StoredPlace& place) const {
  const bool by_feature = !is_final() || !place.feature.empty();
  const std::vector<float>& numbers = by_feature ? place.feature : place.descriptor;
  const int64_t expected = by_feature ? extractor_.dim : basis_->dim;
  std::string found;
  if (std::ssize(numbers) != expected)
    found = str(numbers.size(), " numbers, expected ", expected);
  else if (!is_usable(numbers))
    found = kTooLarge;
  if (found.empty()) return "";
  return str("place ", place.id, " is skipped: its ", by_feature ? "feature" : "descriptor",
             " has ", found);
}

/// The index holds the values; swap() frees their memory, unlike clear().
void KnownPlaces::add(StoredPlace place) {
  if (first_)
    first_->add(place.feature);
  else if (place.feature.empty())
    index_->add(place.descriptor);
  else  // loaded before the projection was final
    index_->add(descriptor_of(place.feature));
  std::vector<float>().swap(place.descriptor);
  std::vector<float>().swap(place.feature);
  std::string().swap(place.cloud);
  places_.push_back(std::move(place));
}

void KnownPlaces::update() {
  if (places_.empty()) return;
  if (first_) {
    const Projection& learnt = first_->basis();
    if (fitted_to_ != first_->learnt_from()) {
      basis_ = learnt;
      begin_index();
      fitted_to_ = first_->learnt_from();
    }
    for (int64_t i = index_->size(); i < size(); ++i)
      index_->add(descriptor_of(first_->features().row(i)));
  }
  if (stretches_) stretches_->add(places_, *index_);
  use_graph();
}

void KnownPlaces::begin_index() {
  index_.emplace(basis_->dim, basis_->comparison);
  has_graph_ = false;
  stretches_.reset();
  if (score_ == Score::kDistinctMargin && basis_->comparison.same_place)
    stretches_.emplace(*basis_->comparison.same_place);
}

void KnownPlaces::use_graph() {
  if (options_.hnsw_candidates == 0 || has_graph_ || !is_final()) return;
  const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  index_->set_candidate_source(make_hnsw_source(*index_, threads), options_.hnsw_candidates);
  has_graph_ = true;
}

void KnownPlaces::remove_ids(std::span<const int64_t> ids) {
  for (const int64_t id : ids)
    if (const auto position = find(id)) remove(*position);
}

bool KnownPlaces::remove(int64_t position) {
  const auto at = std::ranges::lower_bound(removed_, position);
  if (at != removed_.end() && *at == position) return false;
  removed_.insert(at, position);
  return true;
}

void KnownPlaces::settle(Projection basis) {
  basis_ = std::move(basis);
  begin_index();
  for (int64_t i = 0; i < size(); ++i) index_->add(descriptor_of(first_->features().row(i)));
  first_.reset();
}

void KnownPlaces::settle() {
  first_.reset();
  use_graph();
}

std::vector<float> KnownPlaces::descriptor_of(std::span<const float> feature) const {
  std::vector<float> descriptor(static_cast<size_t>(basis_->dim));
  basis_->describe(feature, descriptor);
  return descriptor;
}

const StoredPlace& KnownPlaces::at(int64_t position) const {
  if (position < 0 || position >= size())
    throw UsageError("no place has the index ", position, ": there are ", size(), " places");
  return places_[static_cast<size_t>(position)];
}

std::optional<int64_t> KnownPlaces::find(int64_t id) const {
  const auto found = std::ranges::lower_bound(places_, id, {}, &StoredPlace::id);
  if (found == places_.end() || found->id != id) return std::nullopt;
  return found - places_.begin();
}

std::map<int64_t, int64_t> KnownPlaces::places_of(const std::string& drive) const {
  std::map<int64_t, int64_t> frames;
  for (int64_t position = 0; position < size(); ++position) {
    const StoredPlace& place = places_[static_cast<size_t>(position)];
    if (place.drive == drive && !std::ranges::binary_search(removed_, position))
      frames[place.frame] = position;
  }
  return frames;
}

bool KnownPlaces::is_ambiguous(int64_t position) const {
  return stretches_ && stretches_->is_long(position);
}

std::vector<int64_t> KnownPlaces::around(int64_t position) const {
  at(position);
  if (!stretches_) return {position};
  const std::span<const int64_t> places = stretches_->around(position);
  return {places.begin(), places.end()};
}

std::vector<int64_t> KnownPlaces::near(int64_t position) const {
  at(position);
  return stretches_ ? stretches_->near(position) : std::vector<int64_t>{position};
}

void KnownPlaces::check_feature(const Description& scan) const {
  if (std::ssize(scan.feature) != extractor_.dim)
    throw UsageError("the scan's feature has ", scan.feature.size(), " numbers; the feature '",
                     extractor_.name, "' has ", extractor_.dim);
  if (!is_usable(scan.feature)) throw UsageError("the scan's feature has ", kTooLarge);
}

Match KnownPlaces::best(const Description& scan, std::span<const int64_t> without) const {
  check_feature(scan);
  if (places_.empty() || !index_) return {};
  std::vector<int64_t> excluded(without.begin(), without.end());
  std::ranges::sort(excluded);
  const auto middle = excluded.insert(excluded.end(), removed_.begin(), removed_.end());
  std::ranges::inplace_merge(excluded, middle);
  return index_->best(descriptor_of(scan.feature), ranges_without(excluded, index_->size()),
                      {.k = options_.k, .score = score_});
}

double KnownPlaces::similarity(const Description& scan, int64_t position) const {
  check_feature(scan);
  at(position);
  return index_->similarity(descriptor_of(scan.feature), position);
}

}  // namespace revisit
