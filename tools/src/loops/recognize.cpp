#include "recognize.h"

#include "cli/terminal.h"
#include "revisit/base/error.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {

void recognize(const ScanStream& next, LoopDetector& detector, bool deskew,
               const std::function<void(const Visit&)>& visit) {
  PointCloud cloud;
  std::optional<ScanRef> before;  // with time and pose
  for (int64_t done = 0; const std::optional<ScanRef> scan = next(); ++done) {
    if (interrupted()) throw Interrupted("interrupted after ", done, " scans");
    Visit seen{.scan = *scan};
    try {
      read_scan_into(*scan, cloud);
    } catch (const InputError& error) {
      seen.found.error = error.what();
      visit(seen);
      continue;
    }
    auto lap = stopwatch();
    if (scan->pose && scan->time) {
      if (deskew && before)
        revisit::deskew(before->pose->inverse() * *scan->pose, *scan->time - *before->time, cloud);
      before = scan;
    }
    seen.found = detector.take(view_of(cloud), {scan->frame, scan->time, scan->pose});
    seen.milliseconds = lap();
    if (!seen.found.error.empty())
      seen.found.error = str(scan->file.string(), ": ", seen.found.error);
    visit(seen);
  }
}

DescribedScan describe_scan(const ScanRef& scan, const std::string& drive, const Map& map,
                            PointCloud& cloud) {
  Description description;
  try {
    read_scan_into(scan, cloud);
    description = map.describe(view_of(cloud));
    if (!description.described())
      description.error = str(scan.file.string(), ": ", description.error);
  } catch (const InputError& error) {
    description = {{}, error.what()};
  }
  return {std::move(description),
          {.drive = drive, .frame = scan.frame, .time = scan.time, .pose = scan.pose}};
}

}  // namespace revisit::cli
