#pragma once

#include <string>

#include "revisit/datasets/dataset.h"
#include "revisit/maps/place_recognizer.h"

namespace revisit::cli {

/// A scan of a drive as a recogniser takes it.
struct DescribedScan {
  pipeline::Description description;  // why_not names the file
  pipeline::StoredPlace place;        // drive, frame, time and pose
  double milliseconds = 0;            // to describe the points, once they are in memory
};

/// Reads the scan into `cloud`, whose memory is used again, and describes it. One that cannot be
/// read is one that cannot be described.
DescribedScan describe_scan(const pipeline::ScanRef& scan, const std::string& drive,
                            const pipeline::PlaceRecognizer& recognizer,
                            pipeline::PointCloud& cloud);

}  // namespace revisit::cli
