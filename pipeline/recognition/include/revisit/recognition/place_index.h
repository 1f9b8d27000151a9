#pragma once

#include <deque>
#include <span>
#include <vector>

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
  /// `descriptor` [Basis::dim], finite.
  void add(std::span<const float> descriptor);
  std::span<const float> descriptor(int64_t place) const;

  /// The options.k places in `candidates` (ranges that do not overlap, ascending) most similar to
  /// `query`, as retrieve() ranks and scores them; no ranks where there is no candidate.
  Match best(std::span<const float> query, std::span<const CandidateRange> candidates,
             const RetrieveOptions& options = {}) const;

 private:
  /// Rows of one size, so that adding a place never moves those that are there.
  struct Block {
    FloatMatrix descriptors, keys;
    std::vector<double> lengths;  // of the descriptors, when they are compared by cosine
  };
  void compare(const Block& block, std::span<const float> query, double length,
               std::span<const int64_t> rows, std::span<double> similarities) const;

  Basis basis_;
  std::deque<Block> blocks_;
  int64_t size_ = 0;
};

}  // namespace revisit::pipeline
