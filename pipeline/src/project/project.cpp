#include <algorithm>
#include <cmath>
#include <numbers>

#include "revisit/pipeline/range_image.h"

namespace revisit::pipeline {

RangeImage project(const PointCloud& cloud, const ImageGeometry& geometry) {
  check_geometry(geometry);
  constexpr float kPi = std::numbers::pi_v<float>;
  const auto radians = [](double degrees) {
    return static_cast<float>(degrees * std::numbers::pi / 180);
  };
  const int width = geometry.width, height = geometry.height;
  const float columns_per_radian = static_cast<float>(width) / (2 * kPi);
  const float odd_half_column = width % 2 ? 0.5F : 0;  // half of an odd width is no whole column
  const float top = radians(geometry.elevation_top);
  const float rows_per_radian =
      static_cast<float>(height) / (top - radians(geometry.elevation_bottom));
  const double value_per_metre = 255 / geometry.max_range;

  RangeImage image{width, height, {}};
  image.pixels.resize(static_cast<size_t>(width) * static_cast<size_t>(height));
  for (const Point& point : cloud.points) {
    if (!is_return(point)) continue;
    // Squares in double: in float, the very near and the very far would leave the range.
    const double x = point.x, y = point.y, z = point.z;
    const double ground = x * x + y * y;
    const float elevation = std::atan2(point.z, static_cast<float>(std::sqrt(ground)));
    const float row = std::floor((top - elevation) * rows_per_radian);
    if (!(row >= 0 && row < static_cast<float>(height))) continue;

    // floor((pi - azimuth) / (2 pi) * width), by half turns: pi - azimuth is the angle clockwise
    // from backwards. A cloud turned by exactly 180 degrees (x and y negated) then lands, without
    // any rounding, exactly half a (even) width further.
    const bool right_half = point.y < 0 || (point.y == 0 && point.x > 0);
    const float clockwise = std::atan2(std::abs(point.y), right_half ? point.x : -point.x);
    const float column_in_half = clockwise * columns_per_radian;
    int column = right_half ? width / 2 + static_cast<int>(column_in_half + odd_half_column)
                            : static_cast<int>(column_in_half);
    if (column >= width) column -= width;  // 180 degrees clockwise of forwards, rounded up

    const auto value = static_cast<float>(std::min(std::sqrt(ground + z * z), geometry.max_range) *
                                          value_per_metre);
    float& pixel = image.pixels[static_cast<size_t>(row) * static_cast<size_t>(width) +
                                static_cast<size_t>(column)];
    if (pixel == 0 || value < pixel) pixel = value;
  }
  return image;
}

}  // namespace revisit::pipeline
