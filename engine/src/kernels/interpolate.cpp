#include "kernels/interpolate.h"

#include <algorithm>

#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

/// The two pixels along one axis that an output pixel lies between, and how far.
struct Between {
  int64_t first, second;
  float weight_first, weight_second;
};

Between locate(int64_t out, int64_t out_size, int64_t size) {
  const float ratio =
      out_size > 1 ? static_cast<float>(size - 1) / static_cast<float>(out_size - 1) : 0.0F;
  const float at = ratio * static_cast<float>(out);
  const int64_t first = std::min(static_cast<int64_t>(at), size - 1);
  const float weight = at - static_cast<float>(first);
  return {first, std::min(first + 1, size - 1), 1 - weight, weight};
}

}  // namespace

void interpolate(const InterpolationProblem& p, const float* input, float* output) {
  const bool copy = p.out_h == p.cropped_h && p.out_w == p.cropped_w;
  parallel_for(p.planes * p.out_h, p.threads, [&](int64_t item, int) {
    const float* image = input + (item / p.out_h * p.h + p.crop) * p.w + p.crop;
    float* out = output + item * p.out_w;
    const int64_t y = item % p.out_h;
    if (copy) {  // not the same as weights of 1 and 0 where a neighbour is not finite
      std::copy_n(image + y * p.w, p.out_w, out);
      return;
    }
    const Between rows = locate(y, p.out_h, p.cropped_h);
    const float *top = image + rows.first * p.w, *bottom = image + rows.second * p.w;
    for (int64_t x = 0; x < p.out_w; ++x) {
      const Between c = locate(x, p.out_w, p.cropped_w);
      out[x] =
          rows.weight_first * (c.weight_first * top[c.first] + c.weight_second * top[c.second]) +
          rows.weight_second *
              (c.weight_first * bottom[c.first] + c.weight_second * bottom[c.second]);
    }
  });
}

}  // namespace revisit::engine
