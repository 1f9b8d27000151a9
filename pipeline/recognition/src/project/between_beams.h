#pragma once

#include "revisit/recognition/range_image.h"

namespace revisit {

/// Fills gaps of at most `rows` pixels between two returns of a column, for sensors with fewer
/// beams than rows. Interpolates 1/range, because on a plane it is nearly linear in the elevation.
void fill_between_beams(RangeImage& image, int rows);

}  // namespace revisit
