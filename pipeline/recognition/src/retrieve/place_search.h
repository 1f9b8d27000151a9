#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "retrieve/shortlist.h"
#include "revisit/recognition/place_index.h"

namespace revisit {

class PlaceSearch {
 public:
  /// Throws UsageError for k or threads < 1.
  PlaceSearch(const PlaceIndex& index, const SearchOptions& options);

  size_t max_batch() const;
  /// `first` is the index of the first query, for Match::query and messages.
  void answer(std::span<const Query> queries, int64_t first, std::span<Match> matches);

 private:
  struct PendingQuery;
  struct Part;
  struct Comparing;
  struct Memory;
  static Memory& memory_of_this_thread();

  void take(std::span<const Query> queries);
  void unite_candidates();
  std::span<const CandidateRange> candidates_of(const PendingQuery& pending) const;
  bool narrowed(const PendingQuery& pending) const;
  void propose();

  void choose_by_products();
  void products_of_run(int64_t place, int64_t n, Part& part) const;
  void scale_to_cosines(int64_t place, int64_t n, const float* rows, Part& part) const;
  const float* rows_together(int64_t place, int64_t n, Part& part) const;

  double length_at(int64_t place) const;
  void list_chosen(size_t q, std::vector<int64_t>& chosen) const;
  int64_t looked_at() const;
  void find_descriptors(Comparing& memory) const;
  void compare_with_chosen(std::span<const float> descriptor, double length,
                           Comparing& memory) const;
  void keep_distinct(Comparing& memory) const;
  Match compare(size_t q, int64_t number) const;

  const PlaceIndex& index_;
  const SearchOptions& options_;
  Memory& memory_;
  int64_t keep_;  // cosines: number of candidates compared exactly, those with the largest products
  float slack_;
};

}  // namespace revisit
