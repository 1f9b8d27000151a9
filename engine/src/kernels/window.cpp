#include "kernels/window.h"

#include <algorithm>

namespace revisit::engine {
namespace {

/// Calls `visit(done, run, line, x, axis)` for runs of windows on one line of the last axis: `run`
/// windows, starting `done` after `first`. They read pixels x, x + stride, ... of the image line
/// from pixel `line` on (-1: outside the image), also beyond both ends.
template <class Visit>
void for_each_line(const WindowAxes& axes, int64_t k, int64_t first, int64_t count,
                   const Visit& visit) {
  static constexpr WindowAxis kSinglePixel;
  const size_t outer = axes.empty() ? 0 : axes.size() - 1;
  const WindowAxis& last = axes.empty() ? kSinglePixel : axes.back();
  int64_t line = first / last.windows, i = first % last.windows;
  for (int64_t done = 0; done < count; ++line, i = 0) {
    const int64_t run = std::min(last.windows - i, count - done);
    const int64_t image_line = pixel_under(axes, outer, line, k / last.kernel);
    visit(done, run, image_line < 0 ? -1 : image_line * last.image,
          i * last.stride - last.pad + k % last.kernel * last.dilation, last);
    done += run;
  }
}

}  // namespace

void gather_pixels(const WindowAxes& axes, const float* image, int64_t k, int64_t first,
                   int64_t count, float* row) {
  for_each_line(axes, k, first, count,
                [&](int64_t done, int64_t run, int64_t line, int64_t x, const WindowAxis& axis) {
                  float* out = row + done;
                  if (line < 0) {
                    std::fill_n(out, run, 0.0F);
                    return;
                  }
                  for (int64_t i = 0; i < run; ++i, x += axis.stride)
                    out[i] = x >= 0 && x < axis.image ? image[line + x] : 0.0F;
                });
}

void scatter_add_pixels(const WindowAxes& axes, const float* row, int64_t k, int64_t first,
                        int64_t count, float* image) {
  for_each_line(axes, k, first, count,
                [&](int64_t done, int64_t run, int64_t line, int64_t x, const WindowAxis& axis) {
                  if (line < 0) return;
                  const float* in = row + done;
                  for (int64_t i = 0; i < run; ++i, x += axis.stride)
                    if (x >= 0 && x < axis.image) image[line + x] += in[i];
                });
}

}  // namespace revisit::engine
