#pragma once

#include <cstddef>
#include <cstdint>

#include "revisit/recognition/range_image.h"

namespace revisit {

/// Constants that map directions to pixels of a geometry.
struct Panorama {
  explicit Panorama(const ImageGeometry& geometry);

  int width, height;          // [pixels]
  double half_turn_rows;      // rows in 180 degrees
  double rows_above_horizon;  // negative: the upper edge is below it
  double max_range;           // [m]
  double value_per_meter;
};

/// Returns the pixel (row * width + column) of a point, which must not be the origin, computed in
/// double; -1 above or below the image.
int64_t pixel_of(const Panorama& panorama, float x, float y, float z);

/// Writes the value of the nearest return to each pixel, if the pixel is 0 or larger. `points`
/// [n][4] are x, y, z [m] and an unused value, rotated by `R` [3][3]. Pixels are those of
/// pixel_of() and values are rounded from double to float, so that the image has the same bits on
/// every CPU. Counts returns.
void project_points(const float* points, size_t n, const float* R, const Panorama& panorama,
                    RangeImage& image);

}  // namespace revisit
