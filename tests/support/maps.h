#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "revisit/maps/map.h"

namespace revisit::test {

/// Appends messages.
inline MapStore::Warn into(std::vector<std::string>& messages) {
  return [&messages](const std::string& message) { messages.push_back(message); };
}

/// Creates it if missing.
inline std::unique_ptr<MapStore> map_in(const std::filesystem::path& file,
                                        const FeatureExtractor& extractor,
                                        const MapOptions& options = {}) {
  const MapFingerprint fingerprint = fingerprint_of(extractor, options);
  return open_map(file, MapAccess::kWrite, &fingerprint);
}

/// Returns the index.
inline int64_t add_scan(Map& map, const Description& scan, MapEntry entry = {}) {
  entry.feature = scan.feature;
  return map.add({std::move(entry)}).front();
}

}  // namespace revisit::test
