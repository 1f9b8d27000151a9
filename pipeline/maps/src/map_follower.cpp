#include "map_follower.h"

#include <string>
#include <utility>

namespace revisit {

MapFollower::MapFollower(MapStore& map, const FeatureExtractor& extractor, KnownPlaces& places,
                         Acceptance& acceptance, const MapStore::Warn& warn)
    : map_(map), extractor_(extractor), places_(places), acceptance_(acceptance), warn_(warn) {
  load_updates();
}

void MapFollower::load_updates() {
  is_behind_ = true;
  read_new_places();
  places_.update();
  if (read_to_.removed > removals_known_) places_.remove_ids(map_.removed(removals_known_));
  removals_known_ = read_to_.removed;
  is_behind_ = false;
}

void MapFollower::read_new_places() {
  if (!places_.is_final()) look_for_a_basis();
  acceptance_.refresh();
  if (places_.is_final()) {
    const auto take = [&](StoredPlace&& place) {
      const int64_t id = place.id;
      take_in(std::move(place));
      read_to_.last = id;
    };
    read_to_ = map_.read(read_to_.last, take, warn_);
    return;
  }
  std::vector<StoredPlace> places_read;
  const MapState position = map_.read(
      read_to_.last, [&](StoredPlace&& place) { places_read.push_back(std::move(place)); }, warn_);
  // Another process may have completed the warm-up meanwhile: then these have no features.
  look_for_a_basis();
  read_to_ = position;
  for (StoredPlace& place : places_read) take_in(std::move(place));
}

void MapFollower::look_for_a_basis() {
  if (const auto content = map_.value(kProjectionValue))
    places_.settle(extractor_.open_projection(*content));
}

void MapFollower::take_in(StoredPlace place) {
  if (const std::string misfit = places_.misfit_of(place); !misfit.empty()) return warn_(misfit);
  std::string().swap(place.cloud);
  places_.add(std::move(place));
}

std::vector<int64_t> MapFollower::add(std::vector<StoredPlace> places, Claim* claim) {
  std::vector<std::vector<float>> features;
  for (StoredPlace& place : places) features.push_back(std::exchange(place.feature, {}));
  std::vector<int64_t> ids;
  while (true) {
    const bool settled = places_.is_final();
    for (size_t i = 0; i < places.size(); ++i) {
      places[i].feature = settled ? std::vector<float>() : features[i];
      places[i].descriptor = settled ? places_.descriptor_of(features[i]) : features[i];
    }
    ids = claim != nullptr ? claim->add(places, read_to_.revision)
                           : map_.add(places, read_to_.revision);
    if (ids.size() == places.size()) break;
    load_updates();
  }
  if (ids.empty()) return ids;
  if (ids.front() != read_to_.last + 1) {
    load_updates();
    return ids;
  }
  read_to_.last = ids.back();
  for (size_t i = 0; i < ids.size(); ++i) {
    places[i].id = ids[i];
    take_in(std::move(places[i]));
  }
  places_.update();
  return ids;
}

void MapFollower::settle() {
  const bool first = map_.replace_descriptors(
      [&](const StoredPlace& place) {
        return places_.misfit_of(place).empty() ? places_.descriptor_of(place.feature)
                                                : place.descriptor;
      },
      {{kProjectionValue, places_.basis().content}}, read_to_.revision);
  if (!first) return load_updates();
  ++read_to_.revision;
  places_.settle();
}

}  // namespace revisit
