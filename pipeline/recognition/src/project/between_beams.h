#pragma once

#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

/// Fills gaps of at most `rows` pixels between two returns of a column, as where a sensor has fewer
/// beams than the image rows. Along a plane 1/range is nearly straight in the elevation, so that is
/// interpolated.
void fill_between_beams(RangeImage& image, int rows);

}  // namespace revisit::pipeline
