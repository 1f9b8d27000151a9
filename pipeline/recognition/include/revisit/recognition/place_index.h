#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/nameless_file.h"
#include "revisit/recognition/candidate_source.h"
#include "revisit/recognition/comparison.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/matrix.h"

namespace revisit::pipeline {

/// What is asked, and who may be found. Refers to both.
struct Query {
  std::span<const float> descriptor;
  std::span<const CandidateRange> candidates;  // do not overlap, ascending
};

/// Distinct places are looked for among so many, so that a halt does not hide the others: each
/// takes up to k - 1 comparisons.
inline constexpr int64_t kMostLookedAt = 1000;

struct SearchOptions {
  int k = 4;  // how many places are found; with fewer candidates, all of them
  Score score = Score::kMargin;
  int threads = 1;  // the result is the same for any number
  // Of best_of_many(), between queries:
  std::function<void(int64_t done, int64_t total)> progress = {};
  std::function<bool()> stop = {};  // true: throw Interrupted
};

/// Descriptors of places, added one after another and searched. Places are counted from 0. Queries
/// may run at the same time, additions may not.
///
///   PlaceIndex index(descriptors.d);  // compared by cosine
///   for (int64_t i = 0; i < descriptors.n; ++i) index.add(descriptors.row(i));
///   const CandidateRange before{0, 100};
///   const Match match = index.best(descriptors.row(150), {&before, 1});
///
/// Equal similarities are ordered by place, lower first. A zero vector has cosine 0 with
/// everything.
class PlaceIndex {
 public:
  explicit PlaceIndex(int64_t dim, Comparison comparison = {});

  int64_t size() const { return size_; }
  /// `descriptor` [dim] is copied into memory. Where a source proposes those that are compared
  /// (Comparison::key_candidates), all but the last thousand go into a file, if one can be written.
  /// Throws UsageError for another size and for a number that is not finite.
  void add(std::span<const float> descriptor);
  /// The same without a copy: `descriptor` must stay where it is as long as the index lives.
  void refer_to(std::span<const float> descriptor);
  std::vector<float> descriptor(int64_t place) const;
  /// Of a descriptor [dim] to one place.
  double similarity(std::span<const float> descriptor, int64_t place) const;

  /// Whether descriptors are compared by their cosine.
  bool by_cosine() const { return !comparison_.similarity; }

  /// From now on `source`, which knows all places there are, proposes the `count` places that are
  /// compared; places added later are added to it, too. Throws UsageError when it knows more or
  /// fewer and for a count below 1.
  void choose_by(std::unique_ptr<CandidateSource> source, int64_t count);

  /// The options.k candidates most similar to `query` [dim]; no ranks where there is no candidate.
  /// For Score::kDistinctMargin the distinct ones among the kMostLookedAt most similar.
  /// Where keys (Comparison::key_candidates) or another source choose among more of them, only
  /// those chosen are compared. All are when a source finds fewer than asked for and than
  /// options.k.
  ///
  /// For cosines the matrix product only selects, what is kept is computed again in double
  /// precision. Allocates nothing but the result once a thread has asked before, besides what
  /// Comparison::turn does. Throws UsageError for a query of another size or with a number that is
  /// not finite, for k or threads < 1, and for Score::kDistinctMargin without
  /// Comparison::same_place; NotFinite.
  Match best(std::span<const float> query, std::span<const CandidateRange> candidates,
             const SearchOptions& options = {}) const;

  /// best() of each, faster, as the products of many queries are made at once. Beside the
  /// descriptors that takes some 64 MB, and as much a thread where descriptors do not
  /// follow each other in memory. Throws Interrupted, too.
  std::vector<Match> best_of_many(std::span<const Query> queries,
                                  const SearchOptions& options = {}) const;

 private:
  friend class PlaceSearch;
  /// Places of one number, so that adding one never moves those that are there.
  struct Block {
    FloatMatrix copies;              // of descriptors
    std::vector<const float*> rows;  // the descriptors, there or where they are referred to
    std::vector<double> lengths;     // of the descriptors, for cosines
    std::optional<int64_t> in_file;  // the first descriptor: copies and rows are then empty
  };
  Block& block_to_add_to();
  void spill(Block& block);
  const Block& block_of(int64_t place) const;
  /// The descriptors [n][dim] of places of one block where they follow each other in memory; else
  /// none.
  const float* in_memory(int64_t place, int64_t n) const;
  /// The same -> `to` [n][dim], from wherever they are. Throws Error when they cannot be read.
  void copy(int64_t place, int64_t n, std::span<float> to) const;
  void check(std::span<const float> descriptor, const char* what) const;

  int64_t dim_;
  Comparison comparison_;
  std::deque<Block> blocks_;
  std::unique_ptr<NamelessFile> file_;       // none before the first block is in it
  std::unique_ptr<CandidateSource> source_;  // none: all are compared
  int64_t from_source_ = 0;                  // so many are asked of it
  int64_t size_ = 0;
};

/// A similarity is not finite: of this query (best_of_many() counts them, best() has 0) and place.
class NotFinite : public Error {
 public:
  NotFinite(int64_t of_query, int64_t to_place, double found);
  int64_t query, place;
  double similarity;
};

}  // namespace revisit::pipeline
