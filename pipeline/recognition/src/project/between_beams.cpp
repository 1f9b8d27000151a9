#include "project/between_beams.h"

#include <vector>

namespace revisit {

void fill_between_beams(RangeImage& image, int rows) {
  const auto width = static_cast<size_t>(image.width);
  std::vector<int> last(width, -1);  // [column], row of the last return above
  for (int row = 0; row < image.height; ++row) {
    float* const pixels = image.pixels.data() + static_cast<size_t>(row) * width;
    for (size_t column = 0; column < width; ++column) {
      if (pixels[column] == 0) continue;
      const int above = last[column], gap = row - above;
      last[column] = row;
      if (above < 0 || gap < 2 || gap > rows + 1) continue;
      float* const top = image.pixels.data() + static_cast<size_t>(above) * width + column;
      const float first = 1 / *top, step = (1 / pixels[column] - first) / static_cast<float>(gap);
      for (int i = 1; i < gap; ++i)
        top[static_cast<size_t>(i) * width] = 1 / (first + step * static_cast<float>(i));
    }
  }
}

}  // namespace revisit
