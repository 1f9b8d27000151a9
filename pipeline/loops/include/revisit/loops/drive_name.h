#pragma once

#include <string>

#include "revisit/maps/place_recognizer.h"

namespace revisit::pipeline {

/// The name under which a recording is in a map, or comes into it: `name` when the map has no scan
/// of that name and frame, or the same scan; the same with a number, "monday-2", when that frame of
/// "monday" is another scan. `scan`: the first one of the recording, described, frame `frame`.
std::string drive_in_map(const PlaceRecognizer& recognizer, const std::string& name,
                         const Description& scan, int64_t frame);

}  // namespace revisit::pipeline
