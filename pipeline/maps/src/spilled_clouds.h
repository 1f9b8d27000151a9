#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// The points of places that are in no map, 20 kB each: in a file without a name, not in memory.
/// The file is in TMPDIR, else in /var/tmp or /tmp, and goes with this object or its process.
class SpilledClouds {
 public:
  SpilledClouds() = default;
  ~SpilledClouds();
  SpilledClouds(const SpilledClouds&) = delete;
  SpilledClouds& operator=(const SpilledClouds&) = delete;

  /// Takes the clouds of the next places. Throws Error when they cannot be written: then of none.
  void take(std::span<StoredPlace> places);
  /// The cloud of a place, which counts from 0. Throws Error.
  std::string of(int64_t place) const;

 private:
  int file_ = -1;                    // opened for the first cloud
  std::vector<int64_t> ends_ = {0};  // of the clouds in the file, behind its start
};

}  // namespace revisit::pipeline
