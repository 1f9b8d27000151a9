#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// Whether a scan, taken at `time` [s], is the one at a position of a map, described again. With
/// equal times other than 0 it may have been deskewed otherwise.
bool is_same_scan(const PlaceRecognizer& recognizer, const Description& scan,
                  std::optional<double> time, int64_t position);

/// Places of one drive in a map: frame -> position.
using DrivePlaces = std::map<int64_t, int64_t>;

/// Whether a scan that is no place of a drive may be of it: it is between its places, which others
/// may have been removed from, or the gap is not longer than the drive. A folder named by time,
/// recorded on the next day, begins later.
bool may_be_of(const DrivePlaces& places, int64_t frame);

/// The name under which a recording is in a map, or comes into it: the first of "monday",
/// "monday-2", ... that has no places, or whose places are of the recording (`is_it`); of a merged
/// map also "MAP/monday". A new name
/// is reserved for the recording that begins with the scan `first`, so that no other process takes
/// it. A map of before, whose plain folders had no name, keeps "".
std::string drive_in_map(PlaceRecognizer& recognizer, const std::string& name,
                         const PointsView& first,
                         const std::function<bool(const DrivePlaces&)>& is_it);

}  // namespace revisit::pipeline
