#include "kernels/roi_pooling.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>

#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

/// A region along one axis [pixels].
struct Span {
  int64_t start, size;
};

/// Halves round away from zero. Limits keep the arithmetic in range and are far outside any image.
int64_t to_pixel(float coordinate, float scale) {
  constexpr float kFar = 1e9F;
  return static_cast<int64_t>(std::round(std::clamp(coordinate * scale, -kFar, kFar)));
}

Span span(float first, float last, float scale) {
  const int64_t start = to_pixel(first, scale), end = to_pixel(last, scale);
  return {start, std::max<int64_t>(end - start + 1, 1)};
}

/// Bin `i` of `n`, clipped to the image.
struct Range {
  int64_t begin, end;
};

Range bin(const Span& region, int64_t i, int64_t n, int64_t image) {
  const float size = static_cast<float>(region.size) / static_cast<float>(n);
  const auto begin = static_cast<int64_t>(std::floor(static_cast<float>(i) * size));
  const auto end = static_cast<int64_t>(std::ceil(static_cast<float>(i + 1) * size));
  return {std::clamp<int64_t>(begin + region.start, 0, image),
          std::clamp<int64_t>(end + region.start, 0, image)};
}

bool is_valid(const RoiPoolingProblem& p, const float* roi) {
  return std::all_of(roi, roi + 5, [](float v) { return std::isfinite(v); }) && roi[0] > -1 &&
         roi[0] < static_cast<float>(p.n);
}

}  // namespace

void roi_pool(const RoiPoolingProblem& p, const float* input, const float* rois, float* output) {
  parallel_for(p.rois * p.c, p.threads, [&](int64_t item, int) {
    const float* roi = rois + item / p.c * 5;
    float* out = output + item * p.out_h * p.out_w;
    if (!is_valid(p, roi)) {
      std::fill_n(out, p.out_h * p.out_w, std::numeric_limits<float>::quiet_NaN());
      return;
    }
    const float* image = input + (static_cast<int64_t>(roi[0]) * p.c + item % p.c) * p.h * p.w;
    const Span x = span(roi[1], roi[3], p.scale), y = span(roi[2], roi[4], p.scale);
    for (int64_t i = 0; i < p.out_h; ++i)
      for (int64_t j = 0; j < p.out_w; ++j) {
        const Range rows = bin(y, i, p.out_h, p.h), columns = bin(x, j, p.out_w, p.w);
        const bool empty = rows.end <= rows.begin || columns.end <= columns.begin;
        float best = empty ? 0 : -FLT_MAX;
        for (int64_t iy = rows.begin; iy < rows.end; ++iy)
          for (int64_t ix = columns.begin; ix < columns.end; ++ix)
            if (image[iy * p.w + ix] > best) best = image[iy * p.w + ix];
        *out++ = best;
      }
  });
}

}  // namespace revisit::engine
