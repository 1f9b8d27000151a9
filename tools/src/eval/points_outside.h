#pragma once

#include <string>
#include <vector>

#include "eval/feature_options.h"

namespace revisit::cli {

/// Fraction of points outside of the image above which the geometry is probably wrong.
inline constexpr double kManyOutside = 0.1;

/// Warning that names a sensor that fits. `share`: fraction of the points.
std::string points_outside(double share, const ImageGeometry& geometry, const PointCloud& scan);

/// Warns if the median over the projected scans is above kManyOutside.
void warn_of_points_outside(const FeatureOptions& options, const Dataset& dataset,
                            const std::vector<AlignmentRecord>& records);

}  // namespace revisit::cli
