#pragma once

#include <cstdint>
#include <vector>

#include "acceptance.h"
#include "known_places.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// Keeps the loaded entries and the map consistent: loads changes by other processes, and adds
/// entries to both. Keeps references to its arguments.
class MapFollower {
 public:
  MapFollower(MapStore& map, const FeatureExtractor& extractor, KnownPlaces& places,
              Acceptance& acceptance, const MapStore::Warn& warn);

  /// Loads changes. After an error the next call continues with the rest.
  void load_updates();
  /// True if an error interrupted loading or the map reports changes.
  bool has_updates() const { return is_behind_ || map_.has_updates(); }
  /// Adds entries, which must have features, to the map and loads them, after those that other
  /// processes added before. Returns their ids.
  std::vector<int64_t> add(std::vector<StoredPlace> places, Claim* claim);
  /// Makes the projection final in the map, too. If several processes try, the first one wins and
  /// the others load its projection.
  void settle();

 private:
  void look_for_a_basis();
  void read_new_places();
  void take_in(StoredPlace place);

  MapStore& map_;
  const FeatureExtractor& extractor_;
  KnownPlaces& places_;
  Acceptance& acceptance_;
  const MapStore::Warn& warn_;
  MapState read_to_;
  int64_t removals_known_ = 0;
  bool is_behind_ = false;  // an error interrupted loading
};

}  // namespace revisit::pipeline
