#pragma once

#include <cstdint>
#include <vector>

#include "acceptance.h"
#include "known_entries.h"
#include "revisit/maps/map_store.h"

namespace revisit {

/// Loads changes by other processes, and adds entries to the map and to `entries`. Keeps references
/// to its arguments.
class MapFollower {
 public:
  MapFollower(MapStore& map, const FeatureExtractor& extractor, KnownEntries& entries,
              Acceptance& acceptance, const MapStore::Warn& warn);

  /// After an error the next call continues with the rest.
  void load_updates();
  bool has_updates() const { return is_behind_ || map_.has_updates(); }
  /// The entries must have features; they follow those that other processes added before.
  std::vector<int64_t> add(std::vector<MapEntry> entries, Claim* claim);
  /// If several processes make the projection final, the others load that of the first one.
  void store_projection();

 private:
  void look_for_projection();
  void read_new_entries();
  void take_in(MapEntry entry);

  MapStore& map_;
  const FeatureExtractor& extractor_;
  KnownEntries& entries_;
  Acceptance& acceptance_;
  const MapStore::Warn& warn_;
  MapState read_to_;
  int64_t removals_known_ = 0;
  bool is_behind_ = false;
};

}  // namespace revisit
