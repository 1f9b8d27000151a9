#pragma once

#include <functional>

#include "loops/scan_stream.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

/// A scan and what the detector found.
struct Visit {
  pipeline::ScanRef scan;
  pipeline::Detection found;  // why_not names the file
  double milliseconds = 0;    // from the points in memory to the result
};

/// Hands every scan of the stream to the detector and its result to `visit`, also for a scan that
/// cannot be read or described. With `deskew` the motion during a scan that has times of points is
/// taken out, where it and the scan before have times and poses. Throws what LoopDetector::take()
/// does, Interrupted.
void recognise(const ScanStream& next, pipeline::LoopDetector& detector, bool deskew,
               const std::function<bool()>& stop, const std::function<void(const Visit&)>& visit);

}  // namespace revisit::cli
