#pragma once

#include <string>
#include <vector>

#include "revisit/maps/map_store.h"

namespace revisit {

struct WhatWasRead {
  std::vector<StoredPlace> places;
  std::vector<std::string> damages;
  MapState position;
};

inline WhatWasRead read_all(const MapStore& map, int64_t after = 0) {
  WhatWasRead read;
  read.position = map.read(
      after, [&](StoredPlace&& place) { read.places.push_back(std::move(place)); },
      [&](const std::string& damage) { read.damages.push_back(damage); });
  return read;
}

/// Ignores the id.
inline bool same(const StoredPlace& a, const StoredPlace& b) {
  return a.drive == b.drive && a.frame == b.frame && a.time == b.time &&
         a.pose.has_value() == b.pose.has_value() &&
         (!a.pose || a.pose->matrix() == b.pose->matrix()) && a.descriptor == b.descriptor &&
         a.feature == b.feature;
}

}  // namespace revisit
