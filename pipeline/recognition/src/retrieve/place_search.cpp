#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "retrieve/shortlist.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/place_index.h"

namespace revisit {
namespace {

/// Range of norms in which products of floats neither overflow nor underflow.
constexpr double kShortest = 1e-15, kLongest = 1e15;
/// Maximum floats of the queries in one product, and of its places.
constexpr int64_t kFloatsTogether = int64_t{16} << 20;

int64_t row_of(int64_t place) {
  return place % kEntriesPerBlock;
}

/// (-similarity, index in the chosen places): sorts the most similar first, ties by place.
using Ranked = std::pair<double, size_t>;

std::span<Ranked> sort_best(std::span<Ranked> places, size_t most) {
  const std::span<Ranked> best = places.first(std::min(most, places.size()));
  if (best.size() < places.size()) std::nth_element(places.begin(), best.end() - 1, places.end());
  std::ranges::sort(best);
  return best;
}

void rank(std::span<const Ranked> ranked, std::span<const int64_t> chosen,
          const SearchOptions& options, Match& match) {
  match.ranks.reserve(ranked.size());
  match.similarities.reserve(ranked.size());
  for (const auto& [dissimilarity, number] : ranked) {
    match.ranks.push_back(chosen[number]);
    match.similarities.push_back(-dissimilarity);
  }
  const double best = match.similarities.front(), kth = match.similarities.back();
  match.score = options.score == Score::kSimilarity ? best : 2 * best - kth;
}

void unit_length(std::span<const float> x, double length, std::span<float> direction) {
  const double scale = length > 0 ? 1 / length : 0;
  std::ranges::transform(x, direction.begin(),
                         [scale](float v) { return static_cast<float>(v * scale); });
}

int64_t rows_together_of(int64_t d, int64_t most) {
  return std::clamp<int64_t>(kFloatsTogether / std::max<int64_t>(1, d), 8, most);
}

}  // namespace

class PlaceSearch {
 public:
  /// Throws UsageError for k or threads < 1.
  PlaceSearch(const PlaceIndex& index, const SearchOptions& options)
      : index_(index),
        options_(options),
        memory_(memory_of_this_thread()),
        keep_(std::numeric_limits<int64_t>::max()),
        slack_(0) {
    if (options.k < 1) throw UsageError("k: expected at least 1, found ", options.k);
    if (options.threads < 1)
      throw UsageError("threads: expected at least 1, found ", options.threads);
    if (options.score == Score::kVerified)
      throw UsageError("score verified: only registered loops have it");
    if (options.score == Score::kDistinctMargin && !index.comparison_.same_place)
      throw UsageError("score ", name_of(options.score),
                       ": this feature has no similarity threshold for one place");
    if (index.by_cosine()) {
      keep_ = looked_at();
      slack_ = rounding_of_cosines(index.dim_);
    }
  }

  size_t max_batch() const {
    return static_cast<size_t>(index_.by_cosine() ? rows_together_of(index_.dim_, 512) : 64);
  }

  /// `first` is the index of the first query, for Match::query and messages.
  void answer(std::span<const Query> queries, int64_t first, std::span<Match> matches) {
    take(queries);
    if (index_.source_) propose();
    if (std::ranges::any_of(memory_.pending,
                            [this](const PendingQuery& pending) { return narrowed(pending); }))
      choose_by_products();
    parallel_for(static_cast<int64_t>(queries.size()), options_.threads, [&](int64_t q) {
      matches[static_cast<size_t>(q)] = compare(static_cast<size_t>(q), first + q);
    });
  }

 private:
  struct PendingQuery {
    std::span<const float> descriptor;
    double length = 0;                        // for cosines
    size_t first_range = 0, after_range = 0;  // its candidates in Memory::ranges
    int64_t n_candidates = 0;
    bool proposed = false;
  };

  struct Part {
    std::vector<Shortlist> shortlists;  // [query]
    std::vector<float> products;        // [queries][places of a run]
    std::vector<float> rows;            // descriptors copied to be contiguous
    std::vector<float> scales;          // [row] to unit norm; 0: not computed by a product
  };

  struct Comparing {
    std::vector<int64_t> chosen;
    std::vector<std::span<const float>> places;  // descriptors of `chosen`
    std::vector<float> rows;                     // descriptors read from the file
    std::vector<double> similarities;
    std::vector<Ranked> ranked;
  };

  struct Memory {
    std::vector<PendingQuery> pending;
    std::vector<CandidateRange> ranges;  // ranges of all queries; none is empty
    std::vector<CandidateRange> united;
    std::vector<std::vector<int64_t>> proposed;  // [query]
    std::vector<float> directions;               // queries at unit norm
    std::vector<Part> parts;
  };

  static Memory& memory_of_this_thread() {
    thread_local Memory memory;
    return memory;
  }

  int64_t looked_at() const {
    return options_.score == Score::kDistinctMargin ? std::max<int64_t>(options_.k, kMaxExamined)
                                                    : options_.k;
  }

  void take(std::span<const Query> queries) {
    memory_.pending.clear();
    memory_.ranges.clear();
    for (const Query& query : queries) {
      index_.check(query.descriptor, "query");
      PendingQuery pending{query.descriptor, index_.by_cosine() ? length_of(query.descriptor) : 0,
                           memory_.ranges.size()};
      for (const CandidateRange& range : query.candidates) {
        const CandidateRange inside{std::max<int64_t>(range.begin, 0),
                                    std::min(range.end, index_.size_)};
        if (inside.size() <= 0) continue;
        memory_.ranges.push_back(inside);
        pending.n_candidates += inside.size();
      }
      pending.after_range = memory_.ranges.size();
      memory_.pending.push_back(pending);
    }
    unite_candidates();
  }

  void unite_candidates() {
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

  std::span<const CandidateRange> candidates_of(const PendingQuery& pending) const {
    return std::span(memory_.ranges)
        .subspan(pending.first_range, pending.after_range - pending.first_range);
  }

  bool narrowed(const PendingQuery& pending) const {
    return keep_ < pending.n_candidates && !pending.proposed;
  }

  void propose() {
    const auto n_queries = static_cast<int64_t>(memory_.pending.size());
    if (memory_.proposed.size() < memory_.pending.size())
      memory_.proposed.resize(memory_.pending.size());
    // Threads split several queries, or the places of one.
    const int threads_of_one = n_queries > 1 ? 1 : options_.threads;
    parallel_for(n_queries, options_.threads, [&](int64_t q) {
      PendingQuery& pending = memory_.pending[static_cast<size_t>(q)];
      if (pending.n_candidates <= index_.from_source_) return;
      std::vector<int64_t>& proposed = memory_.proposed[static_cast<size_t>(q)];
      index_.source_->find(pending.descriptor, candidates_of(pending), index_.from_source_,
                           threads_of_one, proposed);
      std::ranges::sort(proposed);
      pending.proposed = static_cast<int64_t>(proposed.size()) >=
                         std::min<int64_t>(options_.k, index_.from_source_);
    });
  }

  /// Fills the shortlists of memory_.parts[0].
  void choose_by_products() {
    const auto d = static_cast<size_t>(index_.dim_);
    memory_.directions.resize(memory_.pending.size() * d);
    for (size_t q = 0; q < memory_.pending.size(); ++q)
      unit_length(memory_.pending[q].descriptor, memory_.pending[q].length,
                  std::span(memory_.directions).subspan(q * d, d));
    const int64_t n_places = places_of(memory_.united);
    const int64_t n_parts = std::clamp<int64_t>(n_places / kEntriesPerBlock, 1, options_.threads);
    const size_t n_queries = memory_.pending.size();
    std::vector<Part>& parts = memory_.parts;
    if (parts.size() < static_cast<size_t>(n_parts)) parts.resize(static_cast<size_t>(n_parts));
    parallel_for(n_parts, options_.threads, [&](int64_t i) {
      Part& part = parts[static_cast<size_t>(i)];
      if (part.shortlists.size() < n_queries) part.shortlists.resize(n_queries);
      for (size_t q = 0; q < n_queries; ++q)
        if (narrowed(memory_.pending[q])) part.shortlists[q].begin(keep_, slack_);
      for_each_run(memory_.united, n_places * i / n_parts, n_places * (i + 1) / n_parts,
                   rows_together_of(index_.dim_, kEntriesPerBlock),
                   [&](int64_t place, int64_t n) { products_of_run(place, n, part); });
    });
    for (int64_t i = 1; i < n_parts; ++i)
      for (size_t q = 0; q < n_queries; ++q)
        if (narrowed(memory_.pending[q]))
          parts[0].shortlists[q].offer(parts[static_cast<size_t>(i)].shortlists[q]);
  }

  /// Copies descriptors only if they are not contiguous.
  const float* rows_together(int64_t place, int64_t n, Part& part) const {
    if (const float* const rows = index_.in_memory(place, n)) return rows;
    part.rows.resize(static_cast<size_t>(n * index_.dim_));
    index_.copy(place, n, part.rows);
    return part.rows.data();
  }

  void products_of_run(int64_t place, int64_t n, Part& part) const {
    const int64_t d = index_.dim_;
    const auto n_queries = static_cast<int64_t>(memory_.pending.size());
    const float* const rows = rows_together(place, n, part);
    part.products.resize(static_cast<size_t>(n_queries * n));
    if (n_queries > 1)
      multiply_transposed(n_queries, n, d, memory_.directions.data(), d, rows, d,
                          part.products.data(), n);
    else
      products_of_rows(memory_.directions, rows, part.products);
    scale_to_cosines(place, n, rows, part);
    for (int64_t q = 0; q < n_queries; ++q) {
      const PendingQuery& pending = memory_.pending[static_cast<size_t>(q)];
      if (!narrowed(pending)) continue;
      const float* const products = part.products.data() + q * n;
      Shortlist& shortlist = part.shortlists[static_cast<size_t>(q)];
      const auto ranges = candidates_of(pending);
      auto range = std::ranges::partition_point(
          ranges, [place](const CandidateRange& r) { return r.end <= place; });
      for (; range != ranges.end() && range->begin < place + n; ++range)
        for (int64_t at = std::max(range->begin, place); at < std::min(range->end, place + n); ++at)
          shortlist.offer(products[at - place], at);
    }
  }

  void scale_to_cosines(int64_t place, int64_t n, const float* rows, Part& part) const {
    part.scales.resize(static_cast<size_t>(n));
    for (int64_t i = 0; i < n; ++i) {
      const double length = length_at(place + i);
      const bool safe = length > kShortest && length < kLongest;
      part.scales[static_cast<size_t>(i)] = safe ? static_cast<float>(1 / length) : 0;
    }
    for (size_t q = 0; q < memory_.pending.size(); ++q) {
      float* const products = part.products.data() + static_cast<int64_t>(q) * n;
      for (int64_t i = 0; i < n; ++i) products[i] *= part.scales[static_cast<size_t>(i)];
    }
    for (int64_t i = 0; i < n; ++i) {
      if (part.scales[static_cast<size_t>(i)] > 0) continue;
      const std::span<const float> descriptor(rows + i * index_.dim_,
                                              static_cast<size_t>(index_.dim_));
      for (size_t q = 0; q < memory_.pending.size(); ++q)
        part.products[q * static_cast<size_t>(n) + static_cast<size_t>(i)] =
            static_cast<float>(cosine(memory_.pending[q].descriptor, memory_.pending[q].length,
                                      descriptor, length_at(place + i)));
    }
  }

  double length_at(int64_t place) const {
    return index_.block_of(place).lengths[static_cast<size_t>(row_of(place))];
  }

  void list_chosen(size_t q, std::vector<int64_t>& chosen) const {
    const PendingQuery& pending = memory_.pending[q];
    chosen.clear();
    if (pending.proposed)
      chosen = memory_.proposed[q];
    else if (narrowed(pending))
      for (const Shortlist::Entry& entry : memory_.parts[0].shortlists[q].finish())
        chosen.push_back(entry.position);
    else
      for (const CandidateRange& range : candidates_of(pending))
        for (int64_t place = range.begin; place < range.end; ++place) chosen.push_back(place);
  }

  /// Requires memory.chosen to be ascending.
  void find_descriptors(Comparing& memory) const {
    const std::vector<int64_t>& chosen = memory.chosen;
    const auto d = static_cast<size_t>(index_.dim_);
    memory.places.clear();
    if (index_.file_ && memory.rows.size() < chosen.size() * d)
      memory.rows.resize(chosen.size() * d);
    for (size_t i = 0; i < chosen.size();) {
      const float* rows = index_.in_memory(chosen[i], 1);
      size_t n = 1;
      if (rows == nullptr) {
        while (i + n < chosen.size() && chosen[i + n] == chosen[i + n - 1] + 1 &&
               row_of(chosen[i + n]) != 0)
          ++n;
        const std::span<float> to = std::span(memory.rows).subspan(i * d, n * d);
        index_.copy(chosen[i], static_cast<int64_t>(n), to);
        rows = to.data();
      }
      for (size_t j = 0; j < n; ++j) memory.places.emplace_back(rows + j * d, d);
      i += n;
    }
  }

  /// `length` is the norm of the descriptor, for cosines.
  void compare_with_chosen(std::span<const float> descriptor, double length,
                           Comparing& memory) const {
    memory.similarities.resize(memory.chosen.size());
    if (!index_.by_cosine())
      return index_.comparison_.similarity(descriptor, memory.places, memory.similarities);
    for (size_t i = 0; i < memory.chosen.size(); ++i)
      memory.similarities[i] =
          cosine(descriptor, length, memory.places[i], length_at(memory.chosen[i]));
  }

  /// If fewer than options.k are distinct, the last entry examined stands for the k-th; the score
  /// is then a lower bound.
  void keep_distinct(Comparing& memory) const {
    constexpr size_t kSortedTogether = 100;
    const double same = *index_.comparison_.same_place;
    const std::span<Ranked> ranked = memory.ranked;
    const size_t most = std::min(ranked.size(), static_cast<size_t>(looked_at()));
    size_t kept = 0, sorted = 0;
    const auto is_same = [&](size_t a, size_t b) {
      return index_.comparison_.similarity_of(memory.places[a], memory.places[b]) >= same;
    };
    for (size_t i = 0; i < most && std::cmp_less(kept, options_.k); ++i) {
      if (i == sorted)
        sorted +=
            sort_best(ranked.subspan(sorted), std::min(kSortedTogether, most - sorted)).size();
      // Most are neighbors of the best, so it is compared first.
      const auto known = ranked.first(kept);
      if (std::ranges::none_of(known, [&](const Ranked& better) {
            return is_same(ranked[i].second, better.second);
          }))
        ranked[kept++] = ranked[i];
    }
    const Ranked last = ranked[most - 1];
    memory.ranked.resize(kept);
    if (std::cmp_less(kept, options_.k) && memory.ranked.back() != last)
      memory.ranked.push_back(last);
  }

  Match compare(size_t q, int64_t number) const {
    thread_local Comparing memory_of_this_thread;
    Comparing& memory = memory_of_this_thread;
    const PendingQuery& pending = memory_.pending[q];
    Match match;
    match.query = number;
    if (pending.n_candidates == 0) return match;
    list_chosen(q, memory.chosen);
    find_descriptors(memory);
    compare_with_chosen(pending.descriptor, pending.length, memory);
    memory.ranked.clear();
    for (size_t i = 0; i < memory.chosen.size(); ++i) {
      if (!std::isfinite(memory.similarities[i]))
        throw Error("the similarity of query ", number, " to entry ", memory.chosen[i],
                    " is not finite: ", memory.similarities[i]);
      memory.ranked.emplace_back(-memory.similarities[i], i);
    }
    if (options_.score == Score::kDistinctMargin)
      keep_distinct(memory);
    else
      memory.ranked.resize(sort_best(memory.ranked, static_cast<size_t>(options_.k)).size());
    rank(memory.ranked, memory.chosen, options_, match);
    if (index_.comparison_.relative_yaw)
      match.relative_yaw = index_.comparison_.relative_yaw(
          memory.places[memory.ranked.front().second], pending.descriptor);
    return match;
  }

  const PlaceIndex& index_;
  const SearchOptions& options_;
  Memory& memory_;
  int64_t keep_;  // cosines: number of candidates compared exactly, those with the largest products
  float slack_;
};

Match PlaceIndex::best(std::span<const float> query, std::span<const CandidateRange> candidates,
                       const SearchOptions& options) const {
  PlaceSearch search(*this, options);
  const Query one{query, candidates};
  Match match;
  search.answer({&one, 1}, 0, {&match, 1});
  return match;
}

std::vector<Match> PlaceIndex::best_of_many(std::span<const Query> queries,
                                            const SearchOptions& options) const {
  PlaceSearch search(*this, options);
  std::vector<Match> matches(queries.size());
  for (size_t first = 0; first < queries.size();) {
    if (options.stop && options.stop()) throw Interrupted("retrieval stopped");
    const size_t count = std::min(search.max_batch(), queries.size() - first);
    search.answer(queries.subspan(first, count), static_cast<int64_t>(first),
                  std::span(matches).subspan(first, count));
    first += count;
    if (options.progress)
      options.progress(static_cast<int64_t>(first), static_cast<int64_t>(queries.size()));
  }
  return matches;
}

}  // namespace revisit
