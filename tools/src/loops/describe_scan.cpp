#include "describe_scan.h"

#include "revisit/base/error.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {

DescribedScan describe_scan(const ScanRef& scan, const std::string& drive,
                            const PlaceRecognizer& recognizer, PointCloud& cloud) {
  DescribedScan described;
  described.entry.drive = drive;
  described.entry.frame = scan.frame;
  described.entry.time = scan.time;
  described.entry.pose = scan.pose;
  Description& description = described.description;
  try {
    read_scan_into(scan, cloud);
    auto lap = stopwatch();
    description = recognizer.describe(view_of(cloud));
    described.milliseconds = lap();
    if (!description.described())
      description.error = str(scan.file.string(), ": ", description.error);
  } catch (const InputError& error) {
    description = {{}, error.what()};
  }
  return described;
}

}  // namespace revisit::cli
