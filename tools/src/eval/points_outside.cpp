#include "eval/points_outside.h"

#include <algorithm>
#include <cmath>

#include "cli/messages.h"
#include "cli/table.h"
#include "revisit/datasets/scan_file.h"

namespace revisit::cli {

std::string points_outside(double share, const ImageGeometry& geometry, const PointCloud& scan) {
  const std::string fitting = find_sensor({scan}).name;
  return str(number(100 * share, 0),
             " % of a scan's points are outside of the range image, which spans ",
             number(geometry.elevation_top, 1), " to ", number(geometry.elevation_bottom, 1),
             " degrees; give --sensor ", fitting.empty() ? "auto" : fitting);
}

void warn_of_points_outside(const FeatureOptions& options, const Dataset& dataset,
                            const std::vector<AlignmentRecord>& records) {
  std::vector<float> shares;
  for (const AlignmentRecord& record : records)
    if (!std::isnan(record.outside)) shares.push_back(record.outside);
  if (shares.empty() || options.quiet) return;
  const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::nth_element(shares.begin(), middle, shares.end());
  const float median = *middle;
  if (!(double{median} > kManyOutside)) return;
  const auto typical =
      std::ranges::find(records, median, &AlignmentRecord::outside) - records.begin();
  const PointCloud scan = read_scan(dataset.scans[static_cast<size_t>(typical)]);
  warn(str(points_outside(double{median}, options.image.geometry(), scan), " (median of ",
           shares.size(), " scans)"));
}

}  // namespace revisit::cli
