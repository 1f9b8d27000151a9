#pragma once

#include <string>

#include "revisit/datasets/dataset.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

struct DescribedScan {
  Description description;  // error names the file
  MapEntry entry;           // only drive, frame, time and pose
  double milliseconds = 0;  // to describe the points, without reading
};

/// Reuses the memory of `cloud`. A scan that cannot be read counts as not described.
DescribedScan describe_scan(const ScanRef& scan, const std::string& drive,
                            const PlaceRecognizer& recognizer, PointCloud& cloud);

}  // namespace revisit::cli
