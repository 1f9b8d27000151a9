#include "kernels/upsample.h"

#include <algorithm>
#include <limits>

#include "kernels/parallel.h"

namespace revisit::engine {

void upsample_by_mask(const UpsamplingProblem& p, const float* input, const float* mask,
                      float* output) {
  const int64_t pixels = p.h * p.w, out_pixels = p.out_h * p.out_w;
  parallel_for(p.planes, p.threads, [&](int64_t plane, int) {
    const float *in = input + plane * pixels, *where = mask + plane * pixels;
    float* out = output + plane * out_pixels;
    std::fill_n(out, out_pixels, 0.0F);
    for (int64_t i = 0; i < pixels; ++i) {
      if (!(where[i] > -1 && where[i] < static_cast<float>(out_pixels))) {
        std::fill_n(out, out_pixels, std::numeric_limits<float>::quiet_NaN());
        return;
      }
      out[static_cast<int64_t>(where[i])] = in[i];
    }
  });
}

void upsample_nearest(const UpsamplingProblem& p, const float* input, float* output) {
  const int64_t scale_h = p.out_h / p.h, scale_w = p.out_w / p.w;
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const float* in = input + (item / p.out_h * p.h + item % p.out_h / scale_h) * p.w;
    float* out = output + item * p.out_w;
    for (int64_t x = 0; x < p.w; ++x) out = std::fill_n(out, scale_w, in[x]);
  });
}

}  // namespace revisit::engine
