#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "revisit/base/files.h"
#include "revisit/maps/map_store.h"

namespace revisit {

/// Points of entries without a map, 20 kB each, in a temporary file instead of memory.
class SpilledClouds {
 public:
  /// Moves the clouds to the file. Throws Error if they cannot be written; then none is moved.
  void take(std::span<StoredPlace> places);
  std::string of(int64_t place) const;

 private:
  std::optional<UnnamedFile> file_;
  std::vector<int64_t> ends_ = {0};  // ends of the clouds in the file, after a 0
};

}  // namespace revisit
