#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/place_index.h"
#include "stretches.h"
#include "warm_up.h"

namespace revisit {

/// Indices of entries never change, also after removals. Keeps references to its arguments.
class KnownPlaces {
 public:
  KnownPlaces(const FeatureExtractor& extractor, const RecognizerOptions& options, Score score);

  /// Reason why an entry of a map, which may be untrusted, cannot be added; "" if it can.
  std::string misfit_of(const StoredPlace& place) const;
  /// The caller must call update() afterwards.
  void add(StoredPlace place);
  /// Describes added entries. During the warm-up the projection is estimated again whenever the
  /// number of distinct entries has doubled, and when the warm-up ends.
  void update();
  void remove_ids(std::span<const int64_t> ids);
  /// Returns false if the entry was removed before.
  bool remove(int64_t position);

  bool is_final() const { return !first_; }
  bool is_complete() const { return first_ && first_->is_over(); }
  /// Makes the projection final: the given one, or the estimated one.
  void settle(Projection basis);
  void settle();
  const Projection& basis() const { return *basis_; }
  std::vector<float> descriptor_of(std::span<const float> feature) const;

  int64_t size() const { return std::ssize(places_); }
  /// Without descriptor and feature. Throws UsageError for an invalid index.
  const StoredPlace& at(int64_t position) const;
  std::optional<int64_t> find(int64_t id) const;
  std::map<int64_t, int64_t> places_of(const std::string& drive) const;
  /// Number of entries that do not look like the preceding one; all without same_place.
  int64_t distinct() const { return stretches_ ? stretches_->count() : size(); }
  bool is_ambiguous(int64_t position) const;
  std::vector<int64_t> around(int64_t position) const;
  std::vector<int64_t> near(int64_t position) const;

  void check_feature(const Description& scan) const;
  Match best(const Description& scan, std::span<const int64_t> without) const;
  double similarity(const Description& scan, int64_t position) const;

 private:
  void begin_index();
  void use_graph();

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  const Score score_;
  std::vector<StoredPlace> places_;
  std::vector<int64_t> removed_;  // ascending
  std::optional<WarmUp> first_;   // warm-up, until the projection is final
  std::optional<Projection> basis_;
  int64_t fitted_to_ = 0;
  std::optional<PlaceIndex> index_;  // has all entries after update()
  bool has_graph_ = false;
  std::optional<Stretches> stretches_;  // none without Comparison::same_place
};

}  // namespace revisit
