#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "revisit/pipeline/point_cloud.h"

namespace revisit::pipeline {

/// The panorama a sensor is projected to. Fixed per sensor, so that every scan gives one size.
struct ImageGeometry {
  int width = 4000, height = 112;                    // [pixels]
  double elevation_top = 3, elevation_bottom = -25;  // [deg], of the upper and lower image edge
  double max_range = 80;                             // [m], maps to pixel value 255
  int closing_width = 5, closing_height = 3;  // hole closing rectangle [pixels], odd; 1 x 1 is none
};

/// Preset by sensor name, all 4000 x 112 so that every network gives one feature size:
///
/// | name  | image edges [deg] | row [deg] | beams          | closing w x h |
/// |-------|-------------------|-----------|----------------|---------------|
/// | hdl64 | +3 .. -25         | 0.25      | 64, 0.33..0.5  | 5 x 3         |
/// | hdl32 | +11.33 .. -31.33  | 0.38      | 32, every 1.33 | 5 x 5         |
/// | vlp16 | +16 .. -16        | 0.29      | 16, every 2    | 5 x 9         |
///
/// A row is finer than the beams are apart, as the paper allows, so that pooling does not reach
/// zero; the closing rectangle is then higher than the rows between two beams. The edges of hdl32
/// (beams +10.67..-30.67) and vlp16 (+15..-15) are half a beam outwards, so that no beam lies on
/// one. Throws UsageError naming the nearest preset.
ImageGeometry sensor_geometry(const std::string& sensor);
/// The names sensor_geometry() takes.
std::vector<std::string> sensor_names();
/// The preset of the lowest image that 99 % of a cloud's returns fall into; "" when there is none.
std::string fitting_sensor(const PointCloud& cloud);

/// Pixel values `[height][width]`, 0 (no return) .. 255 (max_range or farther).
/// Column 0 looks backwards (azimuth +180 deg), azimuth falls with the column: a yaw of the cloud
/// by +360/width deg moves every pixel one column to the left, around the edge. Row 0 is the top.
struct RangeImage {
  int width = 0, height = 0;
  std::vector<float> pixels;  // [height][width]
  float at(int row, int column) const { return pixels[static_cast<size_t>(row) * width + column]; }
};

/// Throws UsageError for a geometry that is none: sizes below 1 or beyond reason, edges in the
/// wrong order or beyond +-90 deg, a range that is not positive, an even or too large closing
/// rectangle.
void check_geometry(const ImageGeometry& geometry);

/// Spherical projection (paper, section III-A):
///   column = floor((pi - azimuth) / (2 pi) * width)
///   row    = floor((top - elevation) / (top - bottom) * height), dropped when outside the image
///   pixel  = 255 * min(range, max_range) / max_range, the nearest return wins, 0 without one
/// in double arithmetic: the image has the same bits on every CPU. NaN points and points at the
/// origin are skipped. With an even width a cloud turned by exactly 180 degrees (x and y negated)
/// gives exactly the image shifted by width / 2, which is align case 2. Throws UsageError as
/// check_geometry() does.
RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry);

/// How much of a cloud an image took.
struct Projected {
  int64_t returns = 0;  // points that are one (is_return)
  int64_t outside = 0;  // of these, above or below the image: no pixel knows of them
  double outside_share() const {
    return returns ? static_cast<double>(outside) / static_cast<double>(returns) : 0;
  }
};

/// The same of the cloud turned about the sensor, project(rotated(cloud, R_image_sensor)), without
/// making the turned cloud; into an image whose memory is used again when it is large enough.
Projected project_turned(const PointCloud& cloud, const Eigen::Matrix3f& R_image_sensor,
                         const ImageGeometry& geometry, RangeImage& image);

/// Morphological closing (dilation, then erosion) with the geometry's rectangle, wrap-around in
/// azimuth. Above and below the image counts as absent (neutral for both operations). Throws
/// UsageError for an even rectangle or one larger than the image.
RangeImage close_holes(const RangeImage& image, const ImageGeometry& geometry);
void close_holes_in_place(RangeImage& image, const ImageGeometry& geometry);

/// Writes an 8-bit grey PNG (values rounded). Throws Error when it cannot.
void write_png(const std::string& file, const RangeImage& image);

}  // namespace revisit::pipeline
