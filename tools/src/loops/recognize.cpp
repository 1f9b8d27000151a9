#include "recognize.h"

#include "revisit/base/error.h"
#include "revisit/datasets/observer.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {

void recognize(const ScanStream& next, LoopDetector& detector, bool deskew,
               const std::function<bool()>& stop, const std::function<void(const Visit&)>& visit) {
  PointCloud cloud;
  std::optional<ScanRef> before;  // with time and pose
  for (int64_t done = 0; const std::optional<ScanRef> scan = next(); ++done) {
    if (stop()) throw Interrupted("interrupted after ", done, " scans");
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

}  // namespace revisit::cli
