#pragma once

#include <functional>

#include "loops/scan_stream.h"
#include "revisit/loops/loop_detector.h"

namespace revisit::cli {

struct Visit {
  ScanRef scan;
  Detection found;          // error names the file
  double milliseconds = 0;  // from the points in memory to the result
};

/// Calls `visit` for scans that cannot be read or described, too. `deskew` removes the motion
/// during a scan if its points have times, and if it and the scan before have times and poses.
/// Throws what LoopDetector::take() throws, and Interrupted.
void recognize(const ScanStream& next, LoopDetector& detector, bool deskew,
               const std::function<bool()>& stop, const std::function<void(const Visit&)>& visit);

}  // namespace revisit::cli
