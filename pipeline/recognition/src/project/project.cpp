#include <algorithm>
#include <cmath>
#include <numbers>

#include "project/panorama.h"
#include "revisit/base/error.h"
#include "revisit/recognition/range_image.h"

namespace revisit {

namespace {

void check(bool ok, const char* what, const std::string& found) {
  if (!ok) throw UsageError("image geometry: ", what, ", found ", found);
}

/// Returns the odd number nearest to degrees / pixel (the larger one on a tie), at most `most`.
int odd_pixels(double degrees, double pixel, int most) {
  constexpr double kRounding = 1e-9;  // tolerance for quotients that are integers
  const int largest = most - (most % 2 ? 0 : 1);
  return std::min(2 * static_cast<int>(degrees / pixel / 2 + kRounding) + 1, largest);
}

double half_turns(double radians) {
  return radians / std::numbers::pi;  // exact for a quarter and an eighth of a revolution
}

}  // namespace

std::array<int, 2> closing_rectangle(const ImageGeometry& g) {
  return {
      odd_pixels(g.closing_width, 360.0 / g.width, g.width),
      odd_pixels(g.closing_height, (g.elevation_top - g.elevation_bottom) / g.height, g.height)};
}

void check_geometry(const ImageGeometry& g) {
  constexpr int kLargest = 1 << 16;        // [pixels]
  constexpr int64_t kMaxPixels = 1 << 26;  // 256 MB
  check(g.width >= 1 && g.width <= kLargest, "expected a width from 1 to 65536", str(g.width));
  check(g.height >= 1 && g.height <= kLargest, "expected a height from 1 to 65536", str(g.height));
  check(int64_t{g.width} * g.height <= kMaxPixels, "expected at most 67108864 pixels",
        str(g.width, " x ", g.height));
  check(g.elevation_top <= 90 && g.elevation_bottom >= -90 && g.elevation_top > g.elevation_bottom,
        "expected 90 >= top > bottom >= -90 degrees of elevation",
        str("top ", g.elevation_top, ", bottom ", g.elevation_bottom));
  check(g.max_range > 0 && std::isfinite(g.max_range), "expected a maximum range above 0 m",
        str(g.max_range));
  const auto is_angle = [](double side) { return side >= 0 && side <= 360; };
  check(is_angle(g.closing_width) && is_angle(g.closing_height),
        "expected a closing rectangle of 0 to 360 degrees",
        str(g.closing_width, " x ", g.closing_height));
}

Panorama::Panorama(const ImageGeometry& g)
    : width(g.width),
      height(g.height),
      half_turn_rows(180 * (g.height / (g.elevation_top - g.elevation_bottom))),
      rows_above_horizon(g.elevation_top * (g.height / (g.elevation_top - g.elevation_bottom))),
      max_range(g.max_range),
      value_per_meter(255 / g.max_range) {}

int64_t pixel_of(const Panorama& p, float x, float y, float z) {
  const double ground = std::sqrt(double{x} * double{x} + double{y} * double{y});
  const double elevation = half_turns(std::atan2(double{z}, ground));
  const double row = std::floor(p.rows_above_horizon - elevation * p.half_turn_rows);
  if (!(row >= 0 && row < p.height)) return -1;

  // Computed per half of the image, clockwise from backwards, so that a cloud rotated by exactly
  // 180 degrees (x and y negated) moves by half an (even) width without rounding.
  const bool right_half = y < 0 || (y == 0 && x > 0);
  const double clockwise = half_turns(std::atan2(std::abs(double{y}), double{right_half ? x : -x}));
  const double odd_half_column = p.width % 2 ? 0.5 : 0;  // half of an odd width is not an integer
  const double column_in_half =
      std::floor(clockwise * (0.5 * p.width) + (right_half ? odd_half_column : 0));
  auto column = static_cast<int64_t>(column_in_half) + (right_half ? p.width / 2 : 0);
  if (column >= p.width) column -= p.width;  // 180 degrees clockwise of forwards, rounded up
  return static_cast<int64_t>(row) * p.width + column;
}

void project_rotated(const PointCloud& cloud, const Eigen::Matrix3f& R_image_sensor,
                     const ImageGeometry& geometry, RangeImage& image) {
  check_geometry(geometry);
  image.width = geometry.width;
  image.height = geometry.height;
  image.pixels.assign(static_cast<size_t>(geometry.width) * static_cast<size_t>(geometry.height),
                      0);
  const Eigen::Matrix<float, 3, 3, Eigen::RowMajor> R = R_image_sensor;
  project_points(as_floats(cloud), cloud.points.size(), R.data(), Panorama(geometry), image);
}

RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry) {
  RangeImage image;
  project_rotated(cloud, Eigen::Matrix3f::Identity(), geometry, image);
  return image;
}

}  // namespace revisit
