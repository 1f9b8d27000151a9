#pragma once

#include <functional>
#include <string>

#include "loops/scan_stream.h"
#include "revisit/datasets/dataset.h"
#include "revisit/loops/loop_detector.h"
#include "revisit/maps/map.h"

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
               const std::function<void(const Visit&)>& visit);

struct DescribedScan {
  Description description;  // error names the file
  MapEntry entry;           // only drive, frame, time and pose
};

/// Reuses the memory of `cloud`. A scan that cannot be read counts as not described.
DescribedScan describe_scan(const ScanRef& scan, const std::string& drive, const Map& map,
                            PointCloud& cloud);

}  // namespace revisit::cli
