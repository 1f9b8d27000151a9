#include <algorithm>

#include "revisit/pipeline/range_image.h"

namespace revisit::pipeline {

RangeImage shifted(const RangeImage& image, int columns) {
  RangeImage result = image;
  if (image.width == 0) return result;
  const int by = (columns % image.width + image.width) % image.width;
  for (int row = 0; row < image.height; ++row) {
    const auto begin = result.pixels.begin() + std::ptrdiff_t{row} * image.width;
    std::rotate(begin, begin + by, begin + image.width);
  }
  return result;
}

}  // namespace revisit::pipeline
