#pragma once

#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Fills gaps of at most `rows` pixels between two returns of a column, where beams are fewer than
/// rows. Interpolates 1/range, which along a plane is nearly straight in the elevation.
void fill_between_beams(RangeImage& image, int rows);

}  // namespace revisit::pipeline
