#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "revisit/recognition/point_cloud.h"

namespace revisit {

/// Fixed per sensor, so that all scans have one image size.
struct ImageGeometry {
  int width = 4000, height = 112;                      ///< [pixels]
  double elevation_top = 3, elevation_bottom = -25;    ///< [deg] image edges
  double max_range = 80;                               ///< [m], maps to pixel value 255
  double closing_width = 0.45, closing_height = 0.75;  ///< hole closing rectangle [deg]; 0: none
};

/// Width and height [pixels]: odd numbers nearest to the geometry's degrees, so that the rectangle
/// bridges the same gap at any resolution; no larger than the image.
std::array<int, 2> closing_rectangle(const ImageGeometry& geometry);

/// Pixel values from 0 (no return) to 255 (max_range or farther). Column 0 looks backwards (azimuth
/// +180 deg); azimuth decreases with the column. A yaw of +360/width deg moves every pixel one
/// column to the left, with wrap-around. Row 0 is the top.
struct RangeImage {
  int width = 0, height = 0;  ///< [pixels]
  std::vector<float> pixels;  ///< [height][width]
  int64_t returns = 0;        ///< of the cloud
  int64_t outside = 0;        ///< returns above or below the image, which no pixel shows
  /// Pixel, unchecked.
  float at(int row, int column) const { return pixels[static_cast<size_t>(row) * width + column]; }
  /// Fraction of the returns outside the image, 0 to 1.
  double outside_share() const {
    return returns ? static_cast<double>(outside) / static_cast<double>(returns) : 0;
  }
};

/// Throws UsageError for sizes below 1 or too large, and for edges in the wrong order or beyond
/// +-90 deg. Throws it, too, for a range that is not positive and closing sides outside 0 to 360
/// deg.
void check_geometry(const ImageGeometry& geometry);

/// Spherical projection (paper, section III-A):
///   column = floor((pi - azimuth) / (2 pi) * width)
///   row    = floor((top - elevation) / (top - bottom) * height), dropped if outside the image
///   pixel  = 255 * min(range, max_range) / max_range of the nearest return, 0 without one
/// The arithmetic is double, so that the image has the same bits on every CPU. If a cloud is
/// rotated by exactly 180 degrees (x and y negated, align case 2), an image of even width shifts by
/// exactly width / 2. Throws UsageError as check_geometry() does.
RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry);

/// Computes project(rotated(cloud, R_image_sensor)) without a copy of the cloud; reuses `image`.
void project_rotated(const PointCloud& cloud, const Eigen::Matrix3f& R_image_sensor,
                     const ImageGeometry& geometry, RangeImage& image);

/// Morphological closing (dilation, then erosion) with wrap-around in azimuth; pixels above and
/// below the image are neutral. Throws what check_geometry() throws, and UsageError for a rectangle
/// larger than the image.
RangeImage close_holes(RangeImage image, const ImageGeometry& geometry);

/// Image geometry is 4000 x 112 for all sensors, so that a network has one feature size.
/// docs/reference/FORMATS.md has the table and its sources.
struct Sensor {
  std::string name;            ///< key of sensor_geometry(), e.g. "ouster-os1-128"
  std::string model;           ///< maker and model, for display
  int beams = 0;               ///< 0: no fixed beams
  double top = 0, bottom = 0;  ///< elevations of the outermost beams, or of the field of view [deg]
  ImageGeometry image;         ///< for its scans
};
/// No beam lies on an image's edge; hole closing bridges most neighboring beams.
const std::vector<Sensor>& sensors();

/// Throws UsageError with the most similar name.
ImageGeometry sensor_geometry(const std::string& sensor);
std::vector<std::string> sensor_names();  ///< of sensors()

/// Properties of a sensor that its scans show.
struct SensorFound {
  std::string name;     ///< a name in sensors(); "": unknown, `image` then fits the beams
  ImageGeometry image;  ///< for its scans
  std::vector<double> elevations;  ///< of the beams [deg], top first; empty: cannot be separated
  double top = 0, bottom = 0;      ///< [deg], limits of 99 % of the returns
  double inside = 0;               ///< fraction of the returns inside the image
};

/// Finds elevations, top and bottom only. Separates beams by elevation or, if elevations are
/// smeared, by point order as in KITTI.
SensorFound find_beams(const std::vector<PointCloud>& scans);

/// Finds the sensor by its beams, else by its field of view.
SensorFound find_sensor(const std::vector<PointCloud>& scans);

/// An image of one byte per pixel.
struct GrayImage {
  int width = 0, height = 0;    ///< [pixels]
  std::vector<uint8_t> pixels;  ///< [height][width]; row 0 is the top
};

}  // namespace revisit
