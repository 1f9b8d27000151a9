#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "revisit/maps/map_store.h"

namespace revisit::pipeline {

/// As open_map() and check_map().
std::unique_ptr<MapStore> open_postgres_map(const std::string& where, MapAccess access,
                                            const MapIdentity* identity, NumberFormat format);
std::vector<std::string> check_postgres_map(const std::string& where);

}  // namespace revisit::pipeline
