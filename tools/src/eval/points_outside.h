#pragma once

#include <string>
#include <vector>

#include "eval/feature_options.h"

namespace revisit::cli {

/// More of a scan's points than this outside of its image are a sign of a wrong geometry.
inline constexpr double kManyOutside = 0.1;

/// What to say of scans of which `share` of the points are above or below the image, and which
/// sensor's image would hold them; `scan` is one of them.
std::string points_outside(double share, const pipeline::ImageGeometry& geometry,
                           const pipeline::PointCloud& scan);

/// Says it once on stderr when the median of all scans that were projected is above kManyOutside.
/// `records` are those of `dataset`.
void warn_of_points_outside(const FeatureOptions& options, const pipeline::Dataset& dataset,
                            const std::vector<pipeline::AlignmentRecord>& records);

}  // namespace revisit::cli
