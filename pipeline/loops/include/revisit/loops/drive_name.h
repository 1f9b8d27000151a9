#pragma once

#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// Whether a scan is the one at a position of a map, described again.
bool is_same_scan(const PlaceRecognizer& recognizer, const Description& scan, int64_t position);

/// The name under which a recording is in a map, or comes into it: the first of "monday",
/// "monday-2", ... that the map does not know, or that has the same scan as `frame`, or that ends
/// before `frame`. `scan`: of the recording, described. A map of before, whose plain folders had no
/// name, keeps "".
std::string drive_in_map(const PlaceRecognizer& recognizer, const std::string& name,
                         const Description& scan, int64_t frame);

}  // namespace revisit::pipeline
