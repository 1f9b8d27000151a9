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

/// The pixel (row * width + column) that the direction of a point other than the origin falls into,
/// by double arithmetic; -1 when it is above or below the image.
int64_t pixel_of(const Panorama& panorama, float x, float y, float z);

/// Gives every pixel that points fall into the value of the nearest of them, where that is less
/// than what the pixel holds or the pixel holds 0. `points` [n][4] are x, y, z [m] and a number
/// that is not looked at; they are turned by `R` [3][3] first. No returns (is_return) are skipped.
///
/// The pixel is that of pixel_of() and the value that of double arithmetic, rounded to float: the
/// image has the same bits on every CPU.
Projected project_points(const float* points, size_t n, const float* R, const Panorama& panorama,
                         float* pixels);

}  // namespace revisit::pipeline
