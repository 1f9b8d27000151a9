#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// "roll,pitch,yaw,x,y,z" in degrees and metres: takes points of a scan to a frame with x forward,
/// y left and z up, by turns about its x, y and z axis, in this order, then a shift. Throws
/// UsageError for anything else.
Eigen::Isometry3d parse_mount(const std::string& text);

/// Moves every point; points without a return stay.
void transform(const Eigen::Isometry3d& T, PointCloud& cloud);

/// Why scans cannot be what a LiDAR that stands upright sees, and what to do; "" when they can.
/// Known are millimetres, axes of a camera, a sensor upside down, and points in the frame of a map,
/// which shows when some of the scans are taken far from its origin.
std::string misfit_of_view(const std::vector<PointCloud>& scans);

}  // namespace revisit::pipeline
