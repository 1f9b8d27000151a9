#pragma once

#include <cstdint>
#include <vector>

namespace revisit {

struct GrayImage {
  int width = 0, height = 0;
  std::vector<uint8_t> pixels;  // [height][width]; row 0 is the top
};

}  // namespace revisit
