#pragma once

#include <string>
#include <string_view>

#include "revisit/maps/map_store.h"

namespace revisit {

/// Lines name=value. Throws UsageError for a "=" in a name or a line break.
std::string text_of(const MapFingerprint& identity);
MapFingerprint identity_from(std::string_view text);

/// Throws InputError that lists each different entry.
void must_match(const std::string& name, const MapFingerprint& map, const MapFingerprint& program);

}  // namespace revisit
