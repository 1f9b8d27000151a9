#pragma once

#include <cstdint>
#include <vector>

namespace revisit::pipeline {

/// A camera image; row 0 is the top.
struct GrayImage {
  int width = 0, height = 0;
  std::vector<uint8_t> pixels;  // [height][width]
};

}  // namespace revisit::pipeline
