#include "retrieve/place_search.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "linear_algebra/linear_algebra.h"
#include "revisit/engine/parallel_for.h"
#include "revisit/recognition/cosine.h"

namespace revisit::pipeline {
namespace {

/// Between these, products of floats neither overflow nor vanish.
constexpr double kShortest = 1e-15, kLongest = 1e15;

int64_t row_of(int64_t place) {
  return place % kPlacesInBlock;
}

}  // namespace

/// What one thread finds in its share of the candidates.
struct PlaceSearch::Part {
  std::vector<Shortlist> shortlists;  // of each query
  std::vector<float> products;        // [queries][places of a run]
  std::vector<int64_t> rows;
  std::vector<double> similarities;
  std::vector<RankedScan> ranked;  // the best so far, when all are compared
};

struct PlaceSearch::Memory {
  std::vector<std::span<const float>> queries;
  std::vector<double> lengths;  // of the queries
  std::vector<float> keys;      // [queries][key_numbers()]
  std::vector<Part> parts;
  size_t used_parts = 0;
  std::vector<int64_t> chosen, rows;
  FloatMatrix descriptors;  // of the chosen
  std::vector<double> similarities;
  std::vector<RankedScan> ranked;
};

PlaceSearch::Memory& PlaceSearch::memory_of_this_thread() {
  thread_local Memory memory;
  return memory;
}

PlaceSearch::PlaceSearch(const PlaceIndex& index, std::span<const CandidateRange> candidates,
                         const RetrieveOptions& options)
    : index_(index), candidates_(candidates), options_(options), memory_(memory_of_this_thread()) {
  for_each_run(0, index.size_, [&](int64_t, int64_t n) { n_candidates_ += n; });
  if (!index.basis_.similarity) {
    keep_ = std::min<int64_t>(options.k, n_candidates_);  // it is room that is taken
    slack_ = rounding_of_cosines(index.basis_.dim);
  } else if (index.basis_.key_candidates < n_candidates_) {
    keep_ = index.basis_.key_candidates;
  }
}

/// Calls `run(place, n)` for the candidates [from, to), as they are counted over all ranges: n that
/// follow each other in a block.
template <class Run>
void PlaceSearch::for_each_run(int64_t from, int64_t to, const Run& run) const {
  int64_t before = 0;
  for (const CandidateRange& range : candidates_) {
    const int64_t begin = std::max<int64_t>(range.begin, 0),
                  end = std::min(range.end, index_.size_);
    if (end <= begin) continue;
    const int64_t last = std::min(end, begin + to - before);
    for (int64_t place = begin + std::max<int64_t>(0, from - before); place < last;) {
      const int64_t n = std::min(last - place, kPlacesInBlock - row_of(place));
      run(place, n);
      place += n;
    }
    before += end - begin;
  }
}

/// Calls `work(from, to, part)` for shares of the candidates, one a thread.
template <class Work>
void PlaceSearch::in_parts(const Work& work) {
  const int64_t n =
      std::clamp<int64_t>(n_candidates_ / kPlacesInBlock, 1, std::max(1, options_.threads));
  memory_.used_parts = static_cast<size_t>(n);
  if (memory_.parts.size() < memory_.used_parts) memory_.parts.resize(memory_.used_parts);
  parallel_for(n, options_.threads, [&](int64_t i) {
    work(n_candidates_ * i / n, n_candidates_ * (i + 1) / n, memory_.parts[static_cast<size_t>(i)]);
  });
}

Match PlaceSearch::answer(std::span<const float> query) {
  if (n_candidates_ == 0) return {};
  memory_.queries.assign(1, query);
  if (keep_ == 0 && !index_.source_) return compare_all(query);
  make_keys();
  if (!index_.source_ || !propose()) {
    if (keep_ == 0) return compare_all(query);
    choose_by_products();
    take_shortlist(0);
  }
  return compare_chosen(query, memory_.lengths[0]);
}

void PlaceSearch::answer_many(const FloatMatrix& queries, int64_t first, int64_t count,
                              std::span<Match> matches) {
  if (n_candidates_ == 0) return;
  memory_.queries.clear();
  for (int64_t q = first; q < first + count; ++q) memory_.queries.push_back(queries.row(q));
  make_keys();
  choose_by_products();
  for (size_t q = 0; q < memory_.queries.size(); ++q) {
    take_shortlist(q);
    matches[static_cast<size_t>(first) + q] =
        compare_chosen(memory_.queries[q], memory_.lengths[q]);
  }
}

void PlaceSearch::make_keys() {
  const auto numbers = static_cast<size_t>(index_.key_numbers());
  memory_.keys.resize(memory_.queries.size() * numbers);
  memory_.lengths.clear();
  for (size_t q = 0; q < memory_.queries.size(); ++q) {
    index_.basis_.key_of.make(memory_.queries[q],
                              std::span(memory_.keys).subspan(q * numbers, numbers));
    memory_.lengths.push_back(length_of(memory_.queries[q]));
  }
}

bool PlaceSearch::is_candidate(int64_t place) const {
  return place >= 0 && place < index_.size_ &&
         std::ranges::any_of(candidates_, [place](const CandidateRange& range) {
           return place >= range.begin && place < range.end;
         });
}

/// The candidates that the source knows of; false when they are fewer than asked for.
bool PlaceSearch::propose() {
  // What is left out of the candidates, as the last places often are, may be the most similar.
  const int64_t left_out = index_.size_ - n_candidates_;
  index_.source_->find(memory_.keys, index_.from_source_ + std::min(left_out, index_.from_source_),
                       memory_.chosen);
  std::erase_if(memory_.chosen, [this](int64_t place) { return !is_candidate(place); });
  std::ranges::sort(memory_.chosen);
  return static_cast<int64_t>(memory_.chosen.size()) >=
         std::min<int64_t>(options_.k, n_candidates_);
}

void PlaceSearch::choose_by_products() {
  const size_t n_queries = memory_.queries.size();
  in_parts([&](int64_t from, int64_t to, Part& part) {
    if (part.shortlists.size() < n_queries) part.shortlists.resize(n_queries);
    for (size_t q = 0; q < n_queries; ++q) part.shortlists[q].begin(keep_, slack_);
    part.products.resize(n_queries * kPlacesInBlock);
    for_each_run(from, to, [&](int64_t place, int64_t n) { products_of_run(place, n, part); });
  });
  for (size_t i = 1; i < memory_.used_parts; ++i)
    for (size_t q = 0; q < n_queries; ++q)
      memory_.parts[0].shortlists[q].offer(memory_.parts[i].shortlists[q]);
}

void PlaceSearch::products_of_run(int64_t place, int64_t n, Part& part) const {
  const PlaceIndex::Block& block = index_.blocks_[static_cast<size_t>(place / kPlacesInBlock)];
  const bool cosines = !index_.basis_.similarity;
  const FloatMatrix& keys = cosines ? block.descriptors : block.keys;
  const auto n_queries = static_cast<int64_t>(memory_.queries.size());
  const int64_t first = row_of(place);
  if (n_queries == 1)
    products_of_rows(memory_.keys, keys, first,
                     std::span(part.products).first(static_cast<size_t>(n)));
  else
    multiply_transposed(n_queries, n, keys.d, memory_.keys.data(), keys.d, keys.row(first).data(),
                        keys.d, part.products.data(), n);
  for (int64_t q = 0; q < n_queries; ++q) {
    const float* products = part.products.data() + q * n;
    Shortlist& shortlist = part.shortlists[static_cast<size_t>(q)];
    for (int64_t i = 0; i < n; ++i) {
      float rough = products[i];
      if (cosines) {
        const double length = block.lengths[static_cast<size_t>(first + i)];
        rough = static_cast<float>(length > kShortest && length < kLongest
                                       ? rough / length
                                       : cosine(memory_.queries[static_cast<size_t>(q)],
                                                memory_.lengths[static_cast<size_t>(q)],
                                                keys.row(first + i), length));
      }
      shortlist.offer(rough, place + i);
    }
  }
}

void PlaceSearch::take_shortlist(size_t query) {
  memory_.chosen.clear();
  for (const Shortlist::Entry& entry : memory_.parts[0].shortlists[query].finish())
    memory_.chosen.push_back(entry.position);
}

Match PlaceSearch::compare_chosen(std::span<const float> query, double length) {
  const std::vector<int64_t>& chosen = memory_.chosen;
  memory_.similarities.resize(chosen.size());
  if (index_.basis_.similarity) {
    // Brought together, as a similarity is told all candidates in one call.
    FloatMatrix& descriptors = memory_.descriptors;
    descriptors.n = static_cast<int64_t>(chosen.size());
    descriptors.d = index_.basis_.dim;
    descriptors.values.resize(static_cast<size_t>(descriptors.n * descriptors.d));
    for (size_t i = 0; i < chosen.size(); ++i)
      std::ranges::copy(index_.descriptor(chosen[i]),
                        descriptors.row(static_cast<int64_t>(i)).begin());
    memory_.rows.resize(chosen.size());
    std::iota(memory_.rows.begin(), memory_.rows.end(), 0);
    index_.basis_.similarity(query, descriptors, memory_.rows, memory_.similarities);
  } else {
    for (size_t i = 0; i < chosen.size(); ++i)
      memory_.similarities[i] =
          cosine(query, length, index_.descriptor(chosen[i]),
                 index_.blocks_[static_cast<size_t>(chosen[i] / kPlacesInBlock)]
                     .lengths[static_cast<size_t>(row_of(chosen[i]))]);
  }
  memory_.ranked.clear();
  for (size_t i = 0; i < chosen.size(); ++i)
    memory_.ranked.emplace_back(-memory_.similarities[i], chosen[i]);
  return best_match(0, memory_.ranked, 1, options_);
}

Match PlaceSearch::compare_all(std::span<const float> query) {
  const auto k = static_cast<size_t>(options_.k);
  in_parts([&](int64_t from, int64_t to, Part& part) {
    part.ranked.clear();
    for_each_run(from, to, [&](int64_t place, int64_t n) {
      part.rows.resize(static_cast<size_t>(n));
      std::iota(part.rows.begin(), part.rows.end(), row_of(place));
      part.similarities.resize(static_cast<size_t>(n));
      index_.basis_.similarity(
          query, index_.blocks_[static_cast<size_t>(place / kPlacesInBlock)].descriptors, part.rows,
          part.similarities);
      for (int64_t i = 0; i < n; ++i)
        part.ranked.emplace_back(-part.similarities[static_cast<size_t>(i)], place + i);
      if (part.ranked.size() > k) {
        std::ranges::nth_element(part.ranked, part.ranked.begin() + options_.k - 1);
        part.ranked.resize(k);
      }
    });
  });
  memory_.ranked.clear();
  for (size_t i = 0; i < memory_.used_parts; ++i)
    memory_.ranked.insert(memory_.ranked.end(), memory_.parts[i].ranked.begin(),
                          memory_.parts[i].ranked.end());
  return best_match(0, memory_.ranked, 1, options_);
}

}  // namespace revisit::pipeline
