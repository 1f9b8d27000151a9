#pragma once

#include <functional>
#include <optional>
#include <string>

#include "revisit/maps/map.h"

namespace revisit {

/// True if `scan`, taken at `time` [s], is the entry at `index`, described again. With equal
/// nonzero times the scans may differ in deskewing.
bool is_same_scan(const Map& map, const Description& scan, std::optional<double> time,
                  int64_t index);

/// True if `frame` lies between those of the entries, or the gap is at most the length of the
/// drive. This separates folders named by time that were recorded on different days.
bool may_belong_to(const DriveEntries& entries, int64_t frame);

/// Name of a recording in the map: the first of "monday", "monday-2", ... that has no entries, or
/// whose entries belong to the recording (`is_it`); in a merged map also "MAP/monday". A new name
/// is reserved for the recording that begins with the scan `first`, so that no other process uses
/// it.
std::string drive_in_map(Map& map, const std::string& name, const PointsView& first,
                         const std::function<bool(const DriveEntries&)>& is_it);

}  // namespace revisit
