#pragma once

#include <string>
#include <vector>

#include "eval/feature_options.h"

namespace revisit::cli {

/// More of a scan's points than this outside of its image are a sign of a wrong geometry.
inline constexpr double kManyOutside = 0.1;

/// Warning that `share` of the points lie outside the image; names a sensor that holds `scan`.
std::string points_outside(double share, const pipeline::ImageGeometry& geometry,
                           const pipeline::PointCloud& scan);

/// Warns once when the median over the projected scans of `dataset` is above kManyOutside.
void warn_of_points_outside(const FeatureOptions& options, const pipeline::Dataset& dataset,
                            const std::vector<pipeline::AlignmentRecord>& records);

}  // namespace revisit::cli
