#include <algorithm>
#include <limits>
#include <vector>

#include "project/extremes.h"
#include "revisit/base/error.h"
#include "revisit/recognition/range_image.h"

namespace revisit {
namespace {

void along_rows(RangeImage& image, int window, Extreme extreme, std::vector<float>& around) {
  if (window == 1) return;
  const int half = window / 2;
  around.resize(static_cast<size_t>(image.width) + window - 1);
  for (int r = 0; r < image.height; ++r) {
    float* const row = image.pixels.data() + static_cast<size_t>(r) * image.width;
    std::copy(row + image.width - half, row + image.width, around.begin());
    std::copy(row, row + image.width, around.begin() + half);
    std::copy(row, row + half, around.begin() + half + image.width);
    sliding_extreme(around.data(), image.width, 1, window, extreme, row);
  }
}

/// Works in strips that fit the L1 cache. Pixels beyond the image are neutral.
void close_columns(RangeImage& image, int window, std::vector<float>& scratch) {
  if (window == 1) return;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr int kStrip = 32;  // columns
  const int half = window / 2;
  const size_t floats = (static_cast<size_t>(image.height) + window - 1) * kStrip;
  scratch.resize(2 * floats);
  float* const first = scratch.data();
  float* const second = first + floats;
  for (int column = 0; column < image.width; column += kStrip) {
    const int columns = std::min(kStrip, image.width - column);
    const size_t margin = static_cast<size_t>(half) * columns;
    const size_t inside = static_cast<size_t>(image.height) * columns;
    const auto surround = [&](float* strip, float value) {
      std::fill_n(strip, margin, value);
      std::fill_n(strip + margin + inside, margin, value);
    };
    surround(first, -kInfinity);
    surround(second, kInfinity);
    float* const origin = image.pixels.data() + column;
    for (int r = 0; r < image.height; ++r)
      std::copy_n(origin + static_cast<size_t>(r) * image.width, columns,
                  first + margin + static_cast<size_t>(r) * columns);
    sliding_extreme(first, image.height, columns, window, Extreme::kMax, second + margin);
    sliding_extreme(second, image.height, columns, window, Extreme::kMin, first);
    for (int r = 0; r < image.height; ++r)
      std::copy_n(first + static_cast<size_t>(r) * columns, columns,
                  origin + static_cast<size_t>(r) * image.width);
  }
}

}  // namespace

RangeImage close_holes(RangeImage image, const ImageGeometry& geometry) {
  check_geometry(geometry);
  const auto [width, height] = closing_rectangle(geometry);
  if (width > image.width || height > image.height)
    throw UsageError("hole closing: a rectangle of ", width, " x ", height,
                     " is larger than the image, ", image.width, " x ", image.height);
  // Dilation by a rectangle is separable: rows and columns in any order.
  std::vector<float> scratch;
  along_rows(image, width, Extreme::kMax, scratch);
  close_columns(image, height, scratch);
  along_rows(image, width, Extreme::kMin, scratch);
  return image;
}

}  // namespace revisit
