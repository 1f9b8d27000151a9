#include "revisit/recognition/place_index.h"

#include <algorithm>
#include <cmath>

#include "retrieve/place_search.h"
#include "revisit/proto/error.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

KeyOf unit_length(int64_t dim) {
  return {dim, [](std::span<const float> x, std::span<float> key) {
            const double length = length_of(x), scale = length > 0 ? 1 / length : 0;
            std::ranges::transform(x, key.begin(),
                                   [scale](float v) { return static_cast<float>(v * scale); });
          }};
}

}  // namespace

PlaceIndex::PlaceIndex(const Basis& basis) : basis_(basis) {
  if (!basis_.similarity) basis_.key_of = unit_length(basis_.dim);
}

void PlaceIndex::check(std::span<const float> descriptor, const char* what) const {
  if (static_cast<int64_t>(descriptor.size()) != basis_.dim)
    throw UsageError(str("PlaceIndex: expected a ", what, " of ", basis_.dim, " numbers, found ",
                         descriptor.size()));
  if (!std::ranges::all_of(descriptor, [](float v) { return std::isfinite(v); }))
    throw UsageError(str("PlaceIndex: a ", what, " holds a number that is not finite"));
}

void PlaceIndex::check(const RetrieveOptions& options) const {
  if (options.k < 1) throw UsageError(str("k: expected at least 1, found ", options.k));
  if (options.threads < 1)
    throw UsageError(str("threads: expected at least 1, found ", options.threads));
}

void PlaceIndex::add(std::span<const float> descriptor) {
  check(descriptor, "descriptor");
  const bool cosines = !basis_.similarity, keys = !cosines && basis_.key_candidates > 0;
  if (size_ % kPlacesInBlock == 0)
    blocks_.push_back({FloatMatrix(kPlacesInBlock, basis_.dim),
                       FloatMatrix(keys ? kPlacesInBlock : 0, basis_.key_of.numbers),
                       std::vector<double>(cosines ? kPlacesInBlock : 0)});
  Block& block = blocks_.back();
  const int64_t row = size_ % kPlacesInBlock;
  std::ranges::copy(descriptor, block.descriptors.row(row).begin());
  if (keys) make_key(descriptor, block.keys.row(row));
  if (cosines) block.lengths[static_cast<size_t>(row)] = length_of(descriptor);
  if (source_) {
    std::vector<float> key(static_cast<size_t>(key_numbers()));
    make_key(descriptor, key);
    source_->add(key);
  }
  ++size_;
}

std::span<const float> PlaceIndex::descriptor(int64_t place) const {
  return blocks_[static_cast<size_t>(place / kPlacesInBlock)].descriptors.row(place %
                                                                              kPlacesInBlock);
}

void PlaceIndex::make_key(std::span<const float> descriptor, std::span<float> key) const {
  basis_.key_of.make(descriptor, key);
}

void PlaceIndex::choose_by(std::unique_ptr<CandidateSource> source, int64_t count) {
  if (key_numbers() == 0) throw UsageError("PlaceIndex: a source of candidates needs keys");
  if (source->size() != size_)
    throw UsageError(
        str("PlaceIndex: expected a source of ", size_, " places, found ", source->size()));
  if (count < 1) throw UsageError(str("PlaceIndex: expected at least 1 candidate, found ", count));
  source_ = std::move(source);
  from_source_ = count;
}

Match PlaceIndex::best(std::span<const float> query, std::span<const CandidateRange> candidates,
                       const RetrieveOptions& options) const {
  check(options);
  check(query, "query");
  return PlaceSearch(*this, candidates, options).answer(query);
}

std::vector<Match> PlaceIndex::best_of_many(const FloatMatrix& queries,
                                            std::span<const CandidateRange> candidates,
                                            const RetrieveOptions& options) const {
  check(options);
  for (int64_t q = 0; q < queries.n; ++q) check(queries.row(q), "query");
  std::vector<Match> matches(static_cast<size_t>(queries.n));
  PlaceSearch search(*this, candidates, options);
  constexpr int64_t kTogether = 64;
  if (search.by_products())
    for (int64_t first = 0; first < queries.n; first += kTogether)
      search.answer_many(queries, first, std::min(kTogether, queries.n - first), matches);
  else
    for (int64_t q = 0; q < queries.n; ++q)
      matches[static_cast<size_t>(q)] = search.answer(queries.row(q));
  return matches;
}

double recall_of(std::span<const Match> exact, std::span<const Match> found) {
  if (exact.size() != found.size())
    throw UsageError(
        str("recall: expected answers to ", exact.size(), " queries, found ", found.size()));
  int64_t ranks = 0, both = 0;
  for (size_t q = 0; q < exact.size(); ++q)
    for (const int64_t place : exact[q].ranks) {
      ++ranks;
      both += std::ranges::count(found[q].ranks, place);
    }
  return ranks > 0 ? static_cast<double>(both) / static_cast<double>(ranks) : 1;
}

}  // namespace revisit::pipeline
