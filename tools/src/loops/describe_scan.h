#pragma once

#include <string>

#include "revisit/datasets/dataset.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

/// Input of a recognizer.
struct DescribedScan {
  pipeline::Description description;  // why_not names the file
  pipeline::StoredPlace place;        // drive, frame, time and pose
  double milliseconds = 0;            // to describe the points, without reading
};

/// Reads the scan into `cloud`, whose memory is reused, and describes it. A scan that cannot be
/// read counts as not described.
DescribedScan describe_scan(const pipeline::ScanRef& scan, const std::string& drive,
                            const pipeline::PlaceRecognizer& recognizer,
                            pipeline::PointCloud& cloud);

}  // namespace revisit::cli
