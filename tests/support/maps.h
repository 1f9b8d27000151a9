#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "map_entries.h"
#include "revisit/maps/map.h"

namespace revisit::test {

/// Creates it if missing. `file`: or the address of a map on a server.
inline std::unique_ptr<MapStore> map_in(const std::filesystem::path& file,
                                        const FeatureExtractor& extractor,
                                        const MapOptions& options = {}) {
  const MapFingerprint fingerprint = fingerprint_of(extractor, options);
  return open_map(file, MapAccess::kWrite, &fingerprint);
}

inline std::unique_ptr<Map> file_map(const std::filesystem::path& file,
                                     const FeatureExtractor& extractor,
                                     const MapOptions& options = {},
                                     const MapStore::Warn& warn = {}) {
  return std::make_unique<Map>(extractor, options, map_in(file, extractor, options), warn);
}

/// Returns the index.
inline int64_t add_scan(Map& map, const Description& scan, MapEntry entry = {}) {
  entry.feature = scan.feature;
  return map.add({std::move(entry)}).front();
}

}  // namespace revisit::test
