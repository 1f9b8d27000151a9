#pragma once

#include <cstdint>
#include <vector>

#include "acceptance.h"
#include "known_places.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// Keeps what is known and a map alike: what others do to the map becomes known, and what is added
/// is in both. Refers to what it is made of.
class MapFollower {
 public:
  MapFollower(MapStore& map, const FeatureExtractor& extractor, KnownPlaces& places,
              Acceptance& acceptance, const MapStore::Damaged& damaged);

  /// What was taken in before an error is not read again; the rest is, the next time.
  void take_in_news();
  /// Whether an error has ended that, or the map says that there is something.
  bool has_news() const { return is_behind_ || map_.has_news(); }
  /// Keeps places, which have their features, in the map and takes them in, behind those that
  /// others added before them. Returns their ids.
  std::vector<int64_t> add(std::vector<StoredPlace> places, Claim* claim);
  /// Settles the basis in the map, too, by the one of those who add places that comes first. The
  /// others take its basis.
  void settle();

 private:
  void look_for_a_basis();
  void read_new_places();
  void take_in(StoredPlace place);

  MapStore& map_;
  const FeatureExtractor& extractor_;
  KnownPlaces& places_;
  Acceptance& acceptance_;
  const MapStore::Damaged& damaged_;
  MapPosition read_to_;
  int64_t removals_known_ = 0;  // of read_to_.removed
  bool is_behind_ = false;      // an error has ended the reading of what is new
};

}  // namespace revisit::pipeline
