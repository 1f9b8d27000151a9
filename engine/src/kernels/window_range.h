#pragma once

#include <algorithm>
#include <cstdint>

namespace revisit::engine {

/// A window along one image axis: its start, and its pixels [begin, end) in the image; none unless
/// `end` > `begin`.
struct WindowRange {
  int64_t start, begin, end;

  WindowRange(int64_t first, int64_t extent, int64_t image)
      : start(first), begin(std::max<int64_t>(first, 0)), end(std::min(first + extent, image)) {}
};

/// Returns whether windows are single pixels, one per pixel of the image.
constexpr bool is_each_pixel(int64_t kernel, int64_t stride, int64_t pad) {
  return kernel == 1 && stride == 1 && pad == 0;
}

}  // namespace revisit::engine
