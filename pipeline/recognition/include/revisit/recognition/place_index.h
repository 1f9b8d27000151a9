#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "revisit/base/error.h"
#include "revisit/base/files.h"
#include "revisit/recognition/match.h"
#include "revisit/recognition/matrix.h"

namespace revisit {

/// A query of PlaceIndex::best_of_many().
struct Query {
  std::span<const float> descriptor;           ///< [dim]
  std::span<const CandidateRange> candidates;  ///< ascending, without overlap
};

/// Maximum number of most similar entries searched for distinct places, so that a standing sensor
/// does not hide the others. Each takes up to k - 1 comparisons.
inline constexpr int64_t kMaxExamined = 1000;

/// Settings of a search.
struct SearchOptions {
  int k = 4;                     ///< number of places returned; with fewer candidates, all of them
  Score score = Score::kMargin;  ///< kind of Match::score
  int threads = 1;               ///< does not change the result
  /// For best_of_many(), between queries:
  std::function<void(int64_t done, int64_t total)> progress = {};
  std::function<bool()> stop = {};  ///< true: throw Interrupted
};

/// Entries are counted from 0 in the order of insertion. Queries may run concurrently with each
/// other, but not with insertions.
///
///   PlaceIndex index(descriptors.d);  // compared by cosine
///   for (int64_t i = 0; i < descriptors.n; ++i) index.add(descriptors.row(i));
///   const CandidateRange before{0, 100};
///   const Match match = index.best(descriptors.row(150), {&before, 1});
///
/// Equal similarities are ordered by index, lower first. A zero vector has cosine 0 with
/// everything.
class PlaceIndex {
 public:
  /// Empty, for descriptors of `dim` dimensions.
  explicit PlaceIndex(int64_t dim, Comparison comparison = {});

  int64_t size() const { return size_; }  ///< number of entries
  /// Copies `descriptor` [dim]. If a source proposes candidates (Comparison::candidates), all
  /// but the last thousand go to a temporary file, if one can be created. Throws UsageError for a
  /// wrong size or a value that is not finite.
  void add(std::span<const float> descriptor);
  /// Adds a view of `descriptor`, which must outlive the index.
  void add_view(std::span<const float> descriptor);
  std::vector<float> descriptor(int64_t place) const;  ///< [dim], a copy
  /// Similarity of `descriptor` [dim] to an entry.
  double similarity(std::span<const float> descriptor, int64_t place) const;
  /// yaw(descriptor) - yaw(place), CCW [rad], if descriptors determine it.
  std::optional<double> relative_yaw(std::span<const float> descriptor, int64_t place) const;

  bool by_cosine() const { return !comparison_.similarity; }  ///< no other Comparison was given

  /// Sets the source that proposes `count` candidates per query; later entries are added to it,
  /// too. The source must have all entries of the index. Throws UsageError if its size differs, and
  /// for a count below 1.
  void set_candidate_source(std::unique_ptr<CandidateSource> source, int64_t count);

  /// Returns the options.k candidates most similar to `query` [dim]; no ranks without candidates.
  /// For Score::kDistinctMargin, the distinct ones among the kMaxExamined most similar. If compact
  /// codes (Comparison::candidates) or another source preselect candidates, only those are
  /// compared. If a source finds fewer than requested and fewer than options.k, all are compared.
  ///
  /// For cosines, the matrix product only selects; the similarities of the result are recomputed in
  /// double precision. After a thread's first query, only the result and Comparison::relative_yaw
  /// allocate memory. Throws UsageError for a query of a wrong size or with a value that is not
  /// finite, for k or threads < 1, and for Score::kDistinctMargin without Comparison::same_place;
  /// Error for a similarity that is not finite.
  Match best(std::span<const float> query, std::span<const CandidateRange> candidates,
             const SearchOptions& options = {}) const;

  /// Returns best() for each query, faster, because matrix products cover many queries. It needs
  /// some 64 MB besides the descriptors, and as much again per thread if descriptors are not
  /// contiguous in memory. Throws Interrupted, too.
  std::vector<Match> best_of_many(std::span<const Query> queries,
                                  const SearchOptions& options = {}) const;

 private:
  friend class PlaceSearch;
  /// Fixed size, so that insertion never moves existing entries.
  struct Block {
    FloatMatrix copies;              ///< owned
    std::vector<const float*> rows;  ///< all descriptors: in `copies`, or views
    std::vector<double> lengths;     ///< norms, for cosines
    std::optional<int64_t> in_file;  ///< its first row; copies and rows are then empty
  };
  Block& block_to_add_to();
  void spill(Block& block);
  const Block& block_of(int64_t place) const;
  /// [n][dim] of entries of one block; nullptr unless they are contiguous in memory.
  const float* in_memory(int64_t place, int64_t n) const;
  /// Copies [n][dim] from memory or file. Throws Error if the file cannot be read.
  void copy(int64_t place, int64_t n, std::span<float> to) const;
  void check(std::span<const float> descriptor, const char* what) const;

  int64_t dim_;
  Comparison comparison_;
  std::deque<Block> blocks_;
  std::unique_ptr<UnnamedFile> file_;        ///< null until the first block is written
  std::unique_ptr<CandidateSource> source_;  ///< null: all entries are compared
  int64_t from_source_ = 0;                  ///< candidates requested from it
  int64_t size_ = 0;
};

/// HNSW graph (FAISS) over half-precision descriptors of `index`, compared by cosine, for maps too
/// large for exhaustive search. Later entries are added to it. Built by `threads` threads; depends
/// on their number. Throws UsageError if the index is empty or has another comparison, or in a
/// build without FAISS.
std::unique_ptr<CandidateSource> make_hnsw_source(const PlaceIndex& index, int threads = 1);

}  // namespace revisit
