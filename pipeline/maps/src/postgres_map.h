#pragma once

#include <string>
#include <string_view>

#include "revisit/maps/map_store.h"

namespace revisit {

/// Like open_map(), which compares the fingerprint, and open_work_queue().
std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapFingerprint* identity, DescriptorType format);
std::unique_ptr<WorkQueue> open_postgres_work(const std::string& where);

}  // namespace revisit
