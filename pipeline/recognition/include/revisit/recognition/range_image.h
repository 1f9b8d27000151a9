#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit::pipeline {

/// The panorama a sensor is projected to. Fixed per sensor, so that every scan gives one size.
struct ImageGeometry {
  int width = 4000, height = 112;                      // [pixels]
  double elevation_top = 3, elevation_bottom = -25;    // [deg], of the upper and lower image edge
  double max_range = 80;                               // [m], maps to pixel value 255
  double closing_width = 0.45, closing_height = 0.75;  // hole closing rectangle [deg]; 0: none
};

/// The rectangle that holes are closed with [pixels]: the odd numbers nearest to the geometry's
/// degrees, so that it bridges the same gap at any size, and no larger than the image.
struct ClosingRectangle {
  int width = 1, height = 1;
};
ClosingRectangle closing_rectangle(const ImageGeometry& geometry);

/// Pixel values `[height][width]`, 0 (no return) .. 255 (max_range or farther).
/// Column 0 looks backwards (azimuth +180 deg), azimuth falls with the column: a yaw of the cloud
/// by +360/width deg moves every pixel one column to the left, around the edge. Row 0 is the top.
struct RangeImage {
  int width = 0, height = 0;
  std::vector<float> pixels;  // [height][width]
  float at(int row, int column) const { return pixels[static_cast<size_t>(row) * width + column]; }
};

/// Throws UsageError for sizes below 1 or beyond reason, or edges in the wrong order or beyond +-90
/// deg. The range must be positive, the sides of the closing rectangle 0 to 360 deg.
void check_geometry(const ImageGeometry& geometry);

/// Spherical projection (paper, section III-A):
///   column = floor((pi - azimuth) / (2 pi) * width)
///   row    = floor((top - elevation) / (top - bottom) * height), dropped when outside the image
///   pixel  = 255 * min(range, max_range) / max_range, the nearest return wins, 0 without one
/// in double arithmetic: the image has the same bits on every CPU. If a cloud turns by exactly 180
/// degrees (x and y negated, align case 2), an image of even width shifts by exactly width / 2.
/// Throws UsageError as check_geometry() does.
RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry);

/// How much of a cloud an image took.
struct Projected {
  int64_t returns = 0;  // points that are one (is_return)
  int64_t outside = 0;  // of these, above or below the image: no pixel knows of them
  double outside_share() const {
    return returns ? static_cast<double>(outside) / static_cast<double>(returns) : 0;
  }
};

/// project(rotated(cloud, R_image_sensor)) without the turned cloud, into an image that is reused.
Projected project_turned(const PointCloud& cloud, const Eigen::Matrix3f& R_image_sensor,
                         const ImageGeometry& geometry, RangeImage& image);

/// Morphological closing (dilation, then erosion), wrap-around in azimuth, neutral above and below.
/// Throws UsageError as check_geometry() does, and for a rectangle larger than the image given.
RangeImage close_holes(const RangeImage& image, const ImageGeometry& geometry);
void close_holes_in_place(RangeImage& image, const ImageGeometry& geometry);

}  // namespace revisit::pipeline
