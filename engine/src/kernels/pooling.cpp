#include "kernels/pooling.h"

#include <algorithm>
#include <cfloat>

#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

/// A window along one axis, clipped to the image.
struct Range {
  int64_t begin, end;
};

Range clip(int64_t start, int64_t kernel, int64_t size) {
  return {std::max<int64_t>(start, 0), std::min(start + kernel, size)};
}

}  // namespace

void max_pool(const PoolingProblem& p, const float* input, float* output, float* mask) {
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const float* image = input + plane * p.h * p.w;
    const Range rows = clip(y * p.stride_h - p.pad_h, p.kernel_h, p.h);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const Range columns = clip(x * p.stride_w - p.pad_w, p.kernel_w, p.w);
      float best = -FLT_MAX;
      int64_t where = -1;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix)
          if (image[iy * p.w + ix] > best) {
            best = image[iy * p.w + ix];
            where = iy * p.w + ix;
          }
      output[item * p.out_w + x] = best;
      if (mask) mask[item * p.out_w + x] = static_cast<float>(where);
    }
  });
}

void average_pool(const PoolingProblem& p, const float* input, float* output) {
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const float* image = input + plane * p.h * p.w;
    const int64_t top = y * p.stride_h - p.pad_h;
    const Range rows = clip(top, p.kernel_h, p.h);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const int64_t left = x * p.stride_w - p.pad_w;
      const Range columns = clip(left, p.kernel_w, p.w);
      float sum = 0;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix) sum += image[iy * p.w + ix];
      const int64_t height = std::min(top + p.kernel_h, p.h + p.pad_h) - top;
      const int64_t width = std::min(left + p.kernel_w, p.w + p.pad_w) - left;
      output[item * p.out_w + x] = sum / static_cast<float>(height * width);
    }
  });
}

}  // namespace revisit::engine
