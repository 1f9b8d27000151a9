#pragma once

#include <deque>
#include <memory>
#include <span>
#include <vector>

#include "revisit/recognition/candidate_source.h"
#include "revisit/recognition/feature.h"
#include "revisit/recognition/retrieve.h"

namespace revisit::pipeline {

/// Descriptors of places, added one after another and searched: what retrieve() is for a whole
/// drive, for one query at a time. Places are counted from 0. Queries may run at the same time,
/// additions may not.
class PlaceIndex {
 public:
  /// `basis`: how descriptors are compared; without a similarity by cosine. When keys choose the
  /// candidates (Basis::key_candidates), only these are compared.
  explicit PlaceIndex(const Basis& basis);

  int64_t size() const { return size_; }
  /// `descriptor` [Basis::dim]. Throws UsageError for another size and for a number that is not
  /// finite.
  void add(std::span<const float> descriptor);
  std::span<const float> descriptor(int64_t place) const;

  /// Numbers of a key; 0 when there are none. For cosines the key is the descriptor at unit length.
  int64_t key_numbers() const { return basis_.key_of.numbers; }
  /// The key of `descriptor` [Basis::dim] -> `key` [key_numbers()].
  void make_key(std::span<const float> descriptor, std::span<float> key) const;

  /// From now on `source`, which knows all places there are, proposes the `count` places that are
  /// compared; places added later are added to it, too. Throws UsageError when it knows more or
  /// fewer, when there are no keys and for a count below 1.
  void choose_by(std::unique_ptr<CandidateSource> source, int64_t count);

  /// The options.k places in `candidates` (ranges that do not overlap, ascending) most similar to
  /// `query` [Basis::dim], as retrieve() ranks and scores them; no ranks where there is no
  /// candidate. The result does not depend on options.threads. All places are searched when a
  /// source proposes fewer than options.k of the candidates. Allocates nothing but the result once
  /// a thread has asked before. Throws UsageError for a query of another size or with a number that
  /// is not finite, and for k or threads < 1.
  Match best(std::span<const float> query, std::span<const CandidateRange> candidates,
             const RetrieveOptions& options = {}) const;

  /// best() of each row of `queries` [n][Basis::dim], faster, as the products of many are made at
  /// once. When keys choose the candidates, those whose products differ by rounding only may change
  /// places.
  std::vector<Match> best_of_many(const FloatMatrix& queries,
                                  std::span<const CandidateRange> candidates,
                                  const RetrieveOptions& options = {}) const;

 private:
  friend class PlaceSearch;
  /// Rows of one size, so that adding a place never moves those that are there.
  struct Block {
    FloatMatrix descriptors;
    FloatMatrix keys;             // empty for cosines: a descriptor is its key but for the length
    std::vector<double> lengths;  // of the descriptors, for cosines
  };
  void check(std::span<const float> descriptor, const char* what) const;
  void check(const RetrieveOptions& options) const;

  Basis basis_;
  std::deque<Block> blocks_;
  std::unique_ptr<CandidateSource> source_;
  int64_t from_source_ = 0;  // so many are asked of it
  int64_t size_ = 0;
};

/// The share of the ranks of `exact` that `found`, the answers to the same queries, have too; 1
/// without ranks. Throws UsageError when there are not as many of both.
double recall_of(std::span<const Match> exact, std::span<const Match> found);

}  // namespace revisit::pipeline
