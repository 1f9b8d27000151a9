#include "kernels/normalize.h"

#include <algorithm>
#include <cmath>

#include "kernels/parallel.h"

namespace revisit::engine {
namespace {

constexpr int64_t kPixels = 256;  // at a time, so that all channels of them stay in cache

void normalize_pixels(const NormalizeProblem& p, const float* in, int64_t count, const float* scale,
                      float* out) {
  float norm[kPixels];
  std::fill_n(norm, count, p.eps);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < count; ++i) norm[i] += in[c * p.pixels + i] * in[c * p.pixels + i];
  for (int64_t i = 0; i < count; ++i) norm[i] = std::sqrt(norm[i]);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < count; ++i)
      out[c * p.pixels + i] = in[c * p.pixels + i] / norm[i] * scale[p.channel_shared ? 0 : c];
}

void normalize_image(const NormalizeProblem& p, const float* in, const float* scale, float* out) {
  double sum = 0;  // of many numbers: single precision would lose the last of them
  for (int64_t i = 0; i < p.c * p.pixels; ++i) sum += static_cast<double>(in[i] * in[i]);
  const float inverse = 1 / std::sqrt(static_cast<float>(sum) + p.eps);
  for (int64_t c = 0; c < p.c; ++c)
    for (int64_t i = 0; i < p.pixels; ++i)
      out[c * p.pixels + i] = in[c * p.pixels + i] * inverse * scale[p.channel_shared ? 0 : c];
}

}  // namespace

void normalize(const NormalizeProblem& p, const float* input, const float* scale, float* output) {
  if (p.across_spatial) {
    parallel_for(p.n, p.threads, [&](int64_t n, int) {
      normalize_image(p, input + n * p.c * p.pixels, scale, output + n * p.c * p.pixels);
    });
    return;
  }
  const int64_t blocks = (p.pixels + kPixels - 1) / kPixels;
  parallel_for(p.n * blocks, p.threads, [&](int64_t item, int) {
    const int64_t first = item % blocks * kPixels;
    const int64_t offset = item / blocks * p.c * p.pixels + first;
    normalize_pixels(p, input + offset, std::min(kPixels, p.pixels - first), scale,
                     output + offset);
  });
}

}  // namespace revisit::engine
