#include "kernels/nchw.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {

void max_pool(const PoolingProblem& p, const float* input, float* output, float* mask) {
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.out_h, y = item % p.out_h;
    const float* image = input + plane * p.h * p.w;
    const WindowRange rows = p.rows(y);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const WindowRange columns = p.columns(x);
      float best = empty_maximum(p.values);
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
    const WindowRange rows = p.rows(y);
    const int64_t height = p.height(rows.start);
    for (int64_t x = 0; x < p.out_w; ++x) {
      const WindowRange columns = p.columns(x);
      float sum = 0;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix) sum += image[iy * p.w + ix];
      output[item * p.out_w + x] = sum / static_cast<float>(height * p.width(columns.start));
    }
  });
}

}  // namespace revisit::engine
