#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace revisit::engine {

/// Sliding kernel along one image axis: element `k` of window `i` reads pixel i * stride - pad + k
/// * dilation. Pixels outside the image are skipped.
struct WindowAxis {
  int64_t image = 1, windows = 1;
  int64_t kernel = 1, stride = 1, pad = 0, dilation = 1;
  int64_t end_surplus = 0;  // trailing pad - pad

  int64_t padded() const { return image + 2 * pad + end_surplus; }
};

/// Any number of spatial axes, slowest first; an empty list is a single pixel.
using WindowAxes = std::vector<WindowAxis>;

inline int64_t product_of(const WindowAxes& axes, int64_t WindowAxis::*size) {
  int64_t result = 1;
  for (const WindowAxis& axis : axes) result *= axis.*size;
  return result;
}

/// Image pixel under kernel element `k` of window `i`, each in C order over the first `n_axes`
/// axes; -1 outside the image.
inline int64_t pixel_under(const WindowAxes& axes, size_t n_axes, int64_t i, int64_t k) {
  int64_t pixel = 0, step = 1;
  for (size_t a = n_axes; a-- > 0;) {
    const WindowAxis& axis = axes[a];
    const int64_t at = i % axis.windows * axis.stride - axis.pad + k % axis.kernel * axis.dilation;
    if (at < 0 || at >= axis.image) return -1;
    pixel += at * step;
    step *= axis.image;
    i /= axis.windows;
    k /= axis.kernel;
  }
  return pixel;
}

/// Row of im2col: pixels under element `k` for `count` windows from `first`; 0 outside the image.
void gather_pixels(const WindowAxes& axes, const float* image, int64_t k, int64_t first,
                   int64_t count, float* row);

/// One row of col2im, the adjoint: adds the row to those pixels.
void scatter_add_pixels(const WindowAxes& axes, const float* row, int64_t k, int64_t first,
                        int64_t count, float* image);

/// A window along one image axis: its start, and its pixels [begin, end) in the image; none unless
/// `end` > `begin`.
struct WindowRange {
  int64_t start, begin, end;

  WindowRange(int64_t first, int64_t extent, int64_t image)
      : start(first), begin(std::max<int64_t>(first, 0)), end(std::min(first + extent, image)) {}

  /// At least 1, so that the mean of an empty window is 0.
  int64_t pixels() const { return std::max<int64_t>(end - begin, 1); }
};

/// Returns whether windows are single pixels, one per pixel of the image.
constexpr bool is_each_pixel(const WindowAxis& axis) {
  return axis.kernel == 1 && axis.stride == 1 && axis.pad == 0 && axis.windows == axis.image;
}

}  // namespace revisit::engine
