#pragma once

#include <cstddef>
#include <cstdint>

#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// A geometry as the numbers that turn directions into pixels.
struct Panorama {
  explicit Panorama(const ImageGeometry& geometry);

  int width, height;          // [pixels]
  double half_turn_rows;      // rows in 180 degrees
  double rows_above_horizon;  // of the upper edge; negative when it is below
  double max_range;           // [m]
  double value_per_metre;     // of pixels
};

/// The pixel (row * width + column) of a point off the origin, in double; -1 above or below.
int64_t pixel_of(const Panorama& panorama, float x, float y, float z);

/// Gives every pixel that returns fall into the value of the nearest, where that is less than the
/// pixel's or the pixel is 0. `points` [n][4] are x, y, z [m] and an unused number, turned first by
/// `R` [3][3]. Pixels are those of pixel_of(), values are rounded to float from double: the image
/// has the same bits on every CPU.
Projected project_points(const float* points, size_t n, const float* R, const Panorama& panorama,
                         float* pixels);

}  // namespace revisit::pipeline
