#pragma once

#include <span>
#include <vector>

#include "retrieve/ranking.h"
#include "retrieve/shortlist.h"
#include "revisit/recognition/place_index.h"

namespace revisit::pipeline {

inline constexpr int64_t kPlacesInBlock = 1024;

/// Queries of a PlaceIndex, all with the same candidates. It works in memory that its thread keeps
/// for the next one.
class PlaceSearch {
 public:
  PlaceSearch(const PlaceIndex& index, std::span<const CandidateRange> candidates,
              const RetrieveOptions& options);

  Match answer(std::span<const float> query);
  /// Whether answer() looks at the products of keys of all candidates, as answer_many() does.
  bool by_products() const { return keep_ > 0 && !index_.source_; }
  /// `queries` [n][d], rows [first, first + count); -> `matches` [n].
  void answer_many(const FloatMatrix& queries, int64_t first, int64_t count,
                   std::span<Match> matches);

 private:
  struct Part;
  struct Memory;
  static Memory& memory_of_this_thread();

  template <class Work>
  void in_parts(const Work& work);
  template <class Run>
  void for_each_run(int64_t from, int64_t to, const Run& run) const;

  void make_keys();
  bool is_candidate(int64_t place) const;
  bool propose();
  void choose_by_products();
  void products_of_run(int64_t place, int64_t n, Part& part) const;
  void take_shortlist(size_t query);
  Match compare_chosen(std::span<const float> query, double length);
  Match compare_all(std::span<const float> query);

  const PlaceIndex& index_;
  std::span<const CandidateRange> candidates_;
  const RetrieveOptions& options_;
  Memory& memory_;
  int64_t n_candidates_ = 0;
  int64_t keep_ = 0;  // so many of the largest products are compared; 0: all candidates are
  float slack_ = 0;
};

}  // namespace revisit::pipeline
