#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Parses "roll,pitch,yaw,x,y,z" in degrees and meters: the transform from the scan's frame to a
/// frame with x forward, y left and z up. It rotates about the x, y and z axis, in this order, then
/// translates. Throws UsageError for anything else.
Eigen::Isometry3d parse_mount(const std::string& text);

/// Leaves points without a return unchanged.
void transform(const Eigen::Isometry3d& T, PointCloud& cloud);

/// Returns the defect and its fix, or "": millimeters, camera axes, a sensor mounted upside down,
/// or points in a map frame (some scans lie far from its origin).
std::string find_view_defect(const std::vector<PointCloud>& scans);

}  // namespace revisit
