#include "retrieve/place_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "linear_algebra/linear_algebra.h"
#include "retrieve/products.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

/// Between these, products of floats neither overflow nor vanish.
constexpr double kShortest = 1e-15, kLongest = 1e15;
/// Of the queries in one product, and of its places.
constexpr int64_t kFloatsTogether = int64_t{16} << 20;

int64_t row_of(int64_t place) {
  return place % kPlacesInBlock;
}

/// (-similarity, place): sorts with the most similar first and equals by place.
using RankedPlace = std::pair<double, int64_t>;

/// Ranks, similarities and score of the best of `places`, which are reordered.
void rank(std::vector<RankedPlace>& places, const SearchOptions& options, Match& match) {
  const size_t kept = std::min(static_cast<size_t>(options.k), places.size());
  const auto end = places.begin() + static_cast<int64_t>(kept);
  std::nth_element(places.begin(), end, places.end());
  std::sort(places.begin(), end);
  match.ranks.reserve(kept);
  match.similarities.reserve(kept);
  for (size_t i = 0; i < kept; ++i) {
    match.ranks.push_back(places[i].second);
    match.similarities.push_back(-places[i].first);
  }
  const double best = match.similarities.front(), kth = match.similarities.back();
  match.score = options.score == Score::kBest ? best : 2 * best - kth;
}

/// Rows of `d` floats that a product takes together.
int64_t rows_together_of(int64_t d, int64_t most) {
  return std::clamp<int64_t>(kFloatsTogether / std::max<int64_t>(1, d), 8, most);
}

}  // namespace

struct PlaceSearch::Asked {
  std::span<const float> descriptor;
  double length = 0;                        // for cosines
  size_t first_range = 0, after_range = 0;  // of its candidates, in Memory::ranges
  int64_t n_candidates = 0;
};

/// What one thread finds in its share of the places.
struct PlaceSearch::Part {
  std::vector<Shortlist> shortlists;  // of each query
  std::vector<float> products;        // [queries][places of a run]
  std::vector<float> rows;            // descriptors brought together
  std::vector<float> scales;          // of these to unit length; 0: not by a product
};

/// What one thread needs to compare a query with those chosen.
struct PlaceSearch::Comparing {
  std::vector<int64_t> chosen;
  std::vector<std::span<const float>> places;
  std::vector<double> similarities;
  std::vector<RankedPlace> ranked;
};

struct PlaceSearch::Memory {
  std::vector<Asked> asked;
  std::vector<CandidateRange> ranges;  // of all queries, none of them empty
  std::vector<CandidateRange> united;  // what any of them may find
  std::vector<float> keys;             // [queries][key_numbers()]
  std::vector<Part> parts;
  std::vector<int64_t> proposed;
};

PlaceSearch::Memory& PlaceSearch::memory_of_this_thread() {
  thread_local Memory memory;
  return memory;
}

PlaceSearch::PlaceSearch(const PlaceIndex& index, const SearchOptions& options)
    : index_(index),
      options_(options),
      memory_(memory_of_this_thread()),
      keep_(std::numeric_limits<int64_t>::max()),
      slack_(0) {
  if (options.k < 1) throw UsageError(str("k: expected at least 1, found ", options.k));
  if (options.threads < 1)
    throw UsageError(str("threads: expected at least 1, found ", options.threads));
  if (index.by_cosine()) {
    keep_ = options.k;
    slack_ = rounding_of_cosines(index.dim_);
  } else if (index.comparison_.key_candidates > 0) {
    keep_ = index.comparison_.key_candidates;
  }
}

size_t PlaceSearch::most_together() const {
  if (index_.source_) return 1;
  return static_cast<size_t>(index_.by_cosine() ? rows_together_of(index_.dim_, 512) : 64);
}

void PlaceSearch::answer(std::span<const Query> queries, int64_t first, std::span<Match> matches) {
  take(queries);
  const bool any_narrowed =
      std::ranges::any_of(memory_.asked, [this](const Asked& asked) { return narrowed(asked); });
  if (any_narrowed || index_.source_) make_keys();
  const bool proposed = index_.source_ && propose();
  if (any_narrowed && !proposed) choose_by_products();
  parallel_for(static_cast<int64_t>(queries.size()), options_.threads, [&](int64_t q) {
    matches[static_cast<size_t>(q)] = compare(static_cast<size_t>(q), proposed, first + q);
  });
}

void PlaceSearch::take(std::span<const Query> queries) {
  memory_.asked.clear();
  memory_.ranges.clear();
  for (const Query& query : queries) {
    index_.check(query.descriptor, "query");
    Asked asked{query.descriptor, index_.by_cosine() ? length_of(query.descriptor) : 0,
                memory_.ranges.size()};
    for (const CandidateRange& range : query.candidates) {
      const CandidateRange inside{std::max<int64_t>(range.begin, 0),
                                  std::min(range.end, index_.size_)};
      if (inside.size() <= 0) continue;
      memory_.ranges.push_back(inside);
      asked.n_candidates += inside.size();
    }
    asked.after_range = memory_.ranges.size();
    memory_.asked.push_back(asked);
  }
  unite_candidates();
}

void PlaceSearch::unite_candidates() {
  std::vector<CandidateRange>& united = memory_.united;
  united.assign(memory_.ranges.begin(), memory_.ranges.end());
  std::ranges::sort(united, {}, &CandidateRange::begin);
  size_t last = 0;
  for (size_t i = 1; i < united.size(); ++i)
    if (united[i].begin <= united[last].end)
      united[last].end = std::max(united[last].end, united[i].end);
    else
      united[++last] = united[i];
  united.resize(std::min(united.size(), last + 1));
}

std::span<const CandidateRange> PlaceSearch::candidates_of(const Asked& asked) const {
  return std::span(memory_.ranges)
      .subspan(asked.first_range, asked.after_range - asked.first_range);
}

/// Whether not all of its candidates are compared.
bool PlaceSearch::narrowed(const Asked& asked) const {
  return keep_ < asked.n_candidates;
}

void PlaceSearch::make_keys() {
  const auto numbers = static_cast<size_t>(index_.key_numbers());
  memory_.keys.resize(memory_.asked.size() * numbers);
  for (size_t q = 0; q < memory_.asked.size(); ++q)
    index_.make_key(memory_.asked[q].descriptor,
                    std::span(memory_.keys).subspan(q * numbers, numbers));
}

/// The candidates of the only query that the source knows of; false when they are fewer than asked
/// for.
bool PlaceSearch::propose() {
  const Asked& asked = memory_.asked.front();
  // What is left out of the candidates, as the last places often are, may be the most similar.
  const int64_t left_out = index_.size_ - asked.n_candidates;
  std::vector<int64_t>& proposed = memory_.proposed;
  index_.source_->find(memory_.keys, index_.from_source_ + std::min(left_out, index_.from_source_),
                       proposed);
  std::erase_if(proposed, [ranges = candidates_of(asked)](int64_t place) {
    return std::ranges::none_of(ranges, [place](const CandidateRange& range) {
      return place >= range.begin && place < range.end;
    });
  });
  std::ranges::sort(proposed);
  return static_cast<int64_t>(proposed.size()) >= std::min<int64_t>(options_.k, asked.n_candidates);
}

/// Calls `run(place, n)` for the places [from, to), as they are counted over the united candidates:
/// n that follow each other in a block, and not too many numbers.
template <class Run>
void PlaceSearch::for_each_run(int64_t from, int64_t to, const Run& run) const {
  const int64_t most = rows_together_of(index_.dim_, kPlacesInBlock);
  int64_t before = 0;
  for (const CandidateRange& range : memory_.united) {
    const int64_t last = std::min(range.end, range.begin + to - before);
    for (int64_t place = range.begin + std::max<int64_t>(0, from - before); place < last;) {
      const int64_t n = std::min({last - place, kPlacesInBlock - row_of(place), most});
      run(place, n);
      place += n;
    }
    before += range.size();
  }
}

/// Fills the shortlists of memory_.parts[0].
void PlaceSearch::choose_by_products() {
  int64_t n_places = 0;
  for (const CandidateRange& range : memory_.united) n_places += range.size();
  const int64_t n_parts = std::clamp<int64_t>(n_places / kPlacesInBlock, 1, options_.threads);
  const size_t n_queries = memory_.asked.size();
  std::vector<Part>& parts = memory_.parts;
  if (parts.size() < static_cast<size_t>(n_parts)) parts.resize(static_cast<size_t>(n_parts));
  parallel_for(n_parts, options_.threads, [&](int64_t i) {
    Part& part = parts[static_cast<size_t>(i)];
    if (part.shortlists.size() < n_queries) part.shortlists.resize(n_queries);
    for (size_t q = 0; q < n_queries; ++q)
      if (narrowed(memory_.asked[q])) part.shortlists[q].begin(keep_, slack_);
    for_each_run(n_places * i / n_parts, n_places * (i + 1) / n_parts,
                 [&](int64_t place, int64_t n) { products_of_run(place, n, part); });
  });
  for (int64_t i = 1; i < n_parts; ++i)
    for (size_t q = 0; q < n_queries; ++q)
      if (narrowed(memory_.asked[q]))
        parts[0].shortlists[q].offer(parts[static_cast<size_t>(i)].shortlists[q]);
}

/// The descriptors of `n` places of a block as one matrix: where they are when they follow each
/// other there.
const float* PlaceSearch::rows_together(int64_t place, int64_t n, Part& part) const {
  const PlaceIndex::Block& block = index_.blocks_[static_cast<size_t>(place / kPlacesInBlock)];
  const auto rows =
      std::span(block.rows).subspan(static_cast<size_t>(row_of(place)), static_cast<size_t>(n));
  const auto d = static_cast<size_t>(index_.dim_);
  const auto apart = [d](const float* a, const float* b) { return b != a + d; };
  if (std::ranges::adjacent_find(rows, apart) == rows.end()) return rows.front();
  part.rows.resize(rows.size() * d);
  for (size_t i = 0; i < rows.size(); ++i)
    std::copy_n(rows[i], d, part.rows.begin() + static_cast<int64_t>(i * d));
  return part.rows.data();
}

void PlaceSearch::products_of_run(int64_t place, int64_t n, Part& part) const {
  const bool cosines = index_.by_cosine();
  const PlaceIndex::Block& block = index_.blocks_[static_cast<size_t>(place / kPlacesInBlock)];
  const int64_t d = index_.key_numbers();
  const auto n_queries = static_cast<int64_t>(memory_.asked.size());
  const float* const rows =
      cosines ? rows_together(place, n, part) : block.keys.row(row_of(place)).data();
  part.products.resize(static_cast<size_t>(n_queries * n));
  // Keys are multiplied in one way only, as no slack makes up for another rounding of products.
  if (cosines && n_queries > 1)
    multiply_transposed(n_queries, n, d, memory_.keys.data(), d, rows, d, part.products.data(), n);
  else
    for (int64_t q = 0; q < n_queries; ++q)
      products_of_rows({memory_.keys.data() + q * d, static_cast<size_t>(d)}, rows,
                       {part.products.data() + q * n, static_cast<size_t>(n)});
  if (cosines) scale_to_cosines(place, n, part);
  for (int64_t q = 0; q < n_queries; ++q) {
    const Asked& asked = memory_.asked[static_cast<size_t>(q)];
    if (!narrowed(asked)) continue;
    const float* const products = part.products.data() + q * n;
    Shortlist& shortlist = part.shortlists[static_cast<size_t>(q)];
    const auto ranges = candidates_of(asked);
    auto range = std::ranges::partition_point(
        ranges, [place](const CandidateRange& r) { return r.end <= place; });
    for (; range != ranges.end() && range->begin < place + n; ++range)
      for (int64_t at = std::max(range->begin, place); at < std::min(range->end, place + n); ++at)
        shortlist.offer(products[at - place], at);
  }
}

/// Products with descriptors become rough cosines.
void PlaceSearch::scale_to_cosines(int64_t place, int64_t n, Part& part) const {
  part.scales.resize(static_cast<size_t>(n));
  for (int64_t i = 0; i < n; ++i) {
    const double length = length_at(place + i);
    const bool safe = length > kShortest && length < kLongest;
    part.scales[static_cast<size_t>(i)] = safe ? static_cast<float>(1 / length) : 0;
  }
  for (size_t q = 0; q < memory_.asked.size(); ++q) {
    float* const products = part.products.data() + static_cast<int64_t>(q) * n;
    for (int64_t i = 0; i < n; ++i) products[i] *= part.scales[static_cast<size_t>(i)];
  }
  for (int64_t i = 0; i < n; ++i) {
    if (part.scales[static_cast<size_t>(i)] > 0) continue;
    for (size_t q = 0; q < memory_.asked.size(); ++q)
      part.products[q * static_cast<size_t>(n) + static_cast<size_t>(i)] =
          static_cast<float>(cosine(memory_.asked[q].descriptor, memory_.asked[q].length,
                                    index_.descriptor(place + i), length_at(place + i)));
  }
}

double PlaceSearch::length_at(int64_t place) const {
  return index_.blocks_[static_cast<size_t>(place / kPlacesInBlock)]
      .lengths[static_cast<size_t>(row_of(place))];
}

/// The places that query `q` is compared with, ascending.
void PlaceSearch::list_chosen(size_t q, bool proposed, std::vector<int64_t>& chosen) const {
  const Asked& asked = memory_.asked[q];
  chosen.clear();
  if (proposed)
    chosen = memory_.proposed;
  else if (narrowed(asked))
    for (const Shortlist::Entry& entry : memory_.parts[0].shortlists[q].finish())
      chosen.push_back(entry.position);
  else
    for (const CandidateRange& range : candidates_of(asked))
      for (int64_t place = range.begin; place < range.end; ++place) chosen.push_back(place);
}

Match PlaceSearch::compare(size_t q, bool proposed, int64_t number) const {
  thread_local Comparing memory;
  const Asked& asked = memory_.asked[q];
  Match match;
  match.query = number;
  if (asked.n_candidates == 0) return match;
  list_chosen(q, proposed, memory.chosen);
  memory.places.clear();
  for (const int64_t place : memory.chosen) memory.places.push_back(index_.descriptor(place));
  memory.similarities.resize(memory.chosen.size());
  if (index_.by_cosine())
    for (size_t i = 0; i < memory.chosen.size(); ++i)
      memory.similarities[i] =
          cosine(asked.descriptor, asked.length, memory.places[i], length_at(memory.chosen[i]));
  else
    index_.comparison_.similarity(asked.descriptor, memory.places, memory.similarities);

  memory.ranked.clear();
  for (size_t i = 0; i < memory.chosen.size(); ++i) {
    if (!std::isfinite(memory.similarities[i]))
      throw NotFinite(number, memory.chosen[i], memory.similarities[i]);
    memory.ranked.emplace_back(-memory.similarities[i], memory.chosen[i]);
  }
  rank(memory.ranked, options_, match);
  if (index_.comparison_.turn)
    match.turn = index_.comparison_.turn(index_.descriptor(match.ranks.front()), asked.descriptor);
  return match;
}

}  // namespace revisit::pipeline
