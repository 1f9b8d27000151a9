#include <algorithm>
#include <cmath>

#include "revisit/datasets/gray_png.h"
#include "revisit/recognition/range_image.h"

namespace revisit::pipeline {

void write_png(const std::string& file, const RangeImage& image) {
  GrayImage gray{image.width, image.height, std::vector<uint8_t>(image.pixels.size())};
  std::transform(image.pixels.begin(), image.pixels.end(), gray.pixels.begin(), [](float pixel) {
    return static_cast<uint8_t>(std::lround(std::clamp(pixel, 0.0F, 255.0F)));
  });
  write_gray_png(file, gray);
}

}  // namespace revisit::pipeline
