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
class KnownEntries {
 public:
  KnownEntries(const FeatureExtractor& extractor, const RecognizerOptions& options, Score score);

  /// Reason why an entry of a map, which may be untrusted, cannot be added; "" if it can.
  std::string misfit_of(const MapEntry& entry) const;
  /// The caller must call update() afterwards.
  void add(MapEntry entry);
  /// Describes added entries. During the warm-up the projection is estimated again whenever the
  /// number of distinct entries has doubled, and when the warm-up ends.
  void update();
  void remove_ids(std::span<const int64_t> ids);
  /// Returns false if the entry was removed before.
  bool remove(int64_t index);

  bool is_final() const { return !warm_up_; }
  bool warm_up_is_over() const { return warm_up_ && warm_up_->is_over(); }
  void set_projection(Projection projection);
  /// Makes the estimated projection final.
  void end_warm_up();
  const Projection& projection() const { return *projection_; }
  std::vector<float> descriptor_of(std::span<const float> feature) const;

  int64_t size() const { return std::ssize(entries_); }
  /// Without descriptor and feature. Throws UsageError for an invalid index.
  const MapEntry& at(int64_t index) const;
  std::optional<int64_t> find(int64_t id) const;
  std::map<int64_t, int64_t> entries_of(const std::string& drive) const;
  /// Number of entries that do not look like the preceding one; all without same_place.
  int64_t distinct() const { return stretches_ ? stretches_->count() : size(); }
  bool is_ambiguous(int64_t index) const;
  std::vector<int64_t> around(int64_t index) const;
  std::vector<int64_t> near(int64_t index) const;

  void check_feature(const Description& scan) const;
  Match best(const Description& scan, std::span<const int64_t> without) const;
  double similarity(const Description& scan, int64_t index) const;

 private:
  void begin_index();
  void use_graph();

  const FeatureExtractor& extractor_;
  const RecognizerOptions& options_;
  const Score score_;
  std::vector<MapEntry> entries_;
  std::vector<int64_t> removed_;   // ascending
  std::optional<WarmUp> warm_up_;  // until the projection is final
  std::optional<Projection> projection_;
  int64_t fitted_to_ = 0;
  std::optional<PlaceIndex> index_;  // has all entries after update()
  bool has_graph_ = false;
  std::optional<Stretches> stretches_;  // none without Comparison::same_place
};

}  // namespace revisit
