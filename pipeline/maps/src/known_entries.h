#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "revisit/maps/map.h"
#include "revisit/recognition/matrix.h"
#include "revisit/recognition/place_index.h"
#include "revisit/recognition/stretches.h"

namespace revisit {

/// Entries of a map in memory. Adds entries, and loads changes by other processes.
///
/// The first entries are the warm-up, from which the descriptor projection is estimated. Only
/// distinct entries count, so that a halt or dense sampling does not bias the projection. An entry
/// is distinct if it does not look like the last distinct one (Comparison::same_place) under the
/// projection of the preceding ones; without a same_place every entry is. The result depends only
/// on the order of the entries, so that all readers of a map obtain the same projection.
///
/// Indices of entries never change, also after removals. Keeps references to its arguments.
class KnownEntries {
 public:
  /// `is_temporary`: nobody reads the map again, so it gets no descriptors and features.
  KnownEntries(const FeatureExtractor& extractor, const MapOptions& options, MapStore& map,
               bool is_temporary, const MapStore::Warn& warn);

  /// After an error the next call continues with the rest.
  void load_updates();
  int64_t loadings() const { return loadings_; }
  bool has_updates() const { return is_behind_ || map_.has_updates(); }
  /// The entries must have features; they follow those that other processes added before. Also
  /// completes the warm-up. The final projection depends on the warm-up alone, not on batches or
  /// kills.
  std::vector<int64_t> add(std::vector<MapEntry> entries);
  /// Removes entries from the map, too. Returns the number removed now.
  int64_t remove(std::span<const int64_t> indices);

  bool is_complete() const { return state_ == State::kComplete; }
  int64_t size() const { return std::ssize(entries_); }
  /// Without descriptor and feature. Throws UsageError for an invalid index.
  const MapEntry& at(int64_t index) const;
  std::optional<int64_t> find(int64_t id) const;
  DriveEntries entries_of(const std::string& drive) const;
  std::set<std::string> drives() const;
  /// Number of entries that do not look like the preceding one; all without same_place.
  int64_t distinct() const { return stretches_ ? stretches_->count() : size(); }
  bool is_ambiguous(int64_t index) const;
  std::vector<int64_t> around(int64_t index, bool margin) const;

  /// Throws UsageError for another feature.
  void check_feature(std::span<const float> feature, const std::string& made_by) const;
  Match best(const Description& scan, std::span<const int64_t> without) const;
  double similarity(const Description& scan, int64_t index) const;
  std::optional<double> relative_yaw(const Description& scan, int64_t index) const;

 private:
  enum class State {
    kCollecting,  // the projection is estimated from the first 1, 2, 4, ... distinct entries
    kProjected,   // it is estimated from all entries of the warm-up, but the map does not have it
    kComplete     // the map has the projection; features are not kept
  };

  void read_new_entries();
  void look_for_projection();
  void take_in(MapEntry entry);
  std::string problem_of(const MapEntry& entry) const;
  void collect(std::span<const float> feature);
  bool is_distinct(std::span<const float> feature);
  void estimate_projection();
  std::vector<int64_t> store(std::span<const MapEntry> entries);
  void store_projection();
  void complete(Projection projection);
  void update();
  void begin_index();
  void use_graph();
  bool remove_index(int64_t index);
  std::vector<float> descriptor_of(std::span<const float> feature) const;

  const FeatureExtractor& extractor_;
  const MapOptions& options_;
  MapStore& map_;
  const bool is_temporary_;
  const MapStore::Warn& warn_;
  MapState read_to_;
  int64_t removals_known_ = 0;
  bool is_behind_ = false;
  int64_t loadings_ = 0;

  State state_ = State::kCollecting;
  FloatMatrix features_;           // of all entries, until the warm-up is complete
  std::vector<int64_t> distinct_;  // of the warm-up
  std::optional<Projection> projection_;
  int64_t estimated_from_ = 0, indexed_from_ = 0;  // distinct entries

  std::vector<MapEntry> entries_;
  std::vector<int64_t> removed_;     // ascending
  std::optional<PlaceIndex> index_;  // has all entries after update()
  bool has_graph_ = false;
  std::optional<Stretches> stretches_;  // none without Comparison::same_place
};

}  // namespace revisit
