#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/base/nameless_file.h"
#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// The points of places that are in no map, 20 kB each: in a file, not in memory.
class SpilledClouds {
 public:
  /// Takes the clouds of the next places. Throws Error when they cannot be written: then of none.
  void take(std::span<StoredPlace> places);
  /// The cloud of a place, which counts from 0. Throws Error.
  std::string of(int64_t place) const;

 private:
  std::optional<NamelessFile> file_;  // made for the first cloud
  std::vector<int64_t> ends_ = {0};   // of the clouds in the file, behind its start
};

}  // namespace revisit::pipeline
