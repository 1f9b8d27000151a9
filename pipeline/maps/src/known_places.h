#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "first_stretch.h"
#include "revisit/maps/place_recognizer.h"
#include "revisit/recognition/place_index.h"
#include "stretches.h"

namespace revisit::pipeline {

/// The places of a recogniser and their descriptors under a basis, which is learnt from the first
/// of them. A place keeps its position, also when others are removed. Refers to what it is made of.
class KnownPlaces {
 public:
  KnownPlaces(const FeatureExtractor& extractor, const RecognizerOptions& options, Score score);

  /// Why a place of a map, which may be a stranger's, cannot be added; "" when it can.
  std::string misfit_of(const StoredPlace& place) const;
  /// update() is to follow.
  void add(StoredPlace place);
  /// After places came, one or many: while the basis is not settled it is learnt again whenever the
  /// distinct ones have doubled, and when they end the first stretch.
  void update();
  /// Places of these ids that are known.
  void remove_ids(std::span<const int64_t> ids);
  /// Whether it was there until now.
  bool remove(int64_t position);

  /// Whether the basis will not change any more.
  bool is_settled() const { return !first_; }
  /// Whether the places that it is learnt from are complete, but it is not settled.
  bool can_be_settled() const { return first_ && first_->is_over(); }
  /// With another basis, or with the one that was learnt.
  void settle(Basis basis);
  void settle();
  const Basis& basis() const { return *basis_; }
  std::vector<float> descriptor_of(std::span<const float> feature) const;

  int64_t size() const { return std::ssize(places_); }
  /// Without its numbers. Throws UsageError for a position without a place.
  const StoredPlace& at(int64_t position) const;
  std::optional<int64_t> find(int64_t id) const;
  std::map<int64_t, int64_t> places_of(const std::string& drive) const;
  /// Places that do not look like the one before; all where similarities do not tell.
  int64_t distinct() const { return stretches_ ? stretches_->count() : size(); }
  bool is_ambiguous(int64_t position) const;
  std::vector<int64_t> around(int64_t position) const;
  std::vector<int64_t> near(int64_t position) const;

  /// Throws UsageError for a scan that another recogniser described.
  void check_feature(const Description& scan) const;
  Match best(const Description& scan, std::span<const int64_t> without) const;
  double similarity(const Description& scan, int64_t position) const;

 private:
  void begin_index();
  void use_graph();

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  const Score score_;
  std::vector<StoredPlace> places_;     // without descriptor and feature
  std::vector<int64_t> removed_;        // positions, ascending; no query answers with them
  std::optional<FirstStretch> first_;   // the places, while the basis is not settled
  std::optional<Basis> basis_;          // nothing before the first place
  int64_t learnt_from_ = 0;             // the basis (FirstStretch)
  std::optional<PlaceIndex> index_;     // of all places after update()
  bool has_graph_ = false;              // the index
  std::optional<Stretches> stretches_;  // none where similarities do not tell
};

}  // namespace revisit::pipeline
