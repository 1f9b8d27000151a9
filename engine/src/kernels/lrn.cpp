#include <algorithm>
#include <cmath>

#include "kernels/nchw.h"
#include "kernels/window.h"
#include "revisit/engine/parallel_for.h"

namespace revisit::engine {
namespace {

constexpr int64_t kPixels = 256;  // per step, so that all their channels stay in cache

/// scale[i] ^ -beta * input[i]. For beta 0.75, used by all published networks, two square roots are
/// many times faster than pow and equally accurate.
void normalize(const float* input, const float* scale, int64_t count, float beta, float* output) {
  if (beta == 0.75F) {
    for (int64_t i = 0; i < count; ++i) {
      const float root = std::sqrt(scale[i]);
      output[i] = input[i] / (root * std::sqrt(root));
    }
    return;
  }
  for (int64_t i = 0; i < count; ++i) output[i] = input[i] * std::pow(scale[i], -beta);
}

}  // namespace

void lrn_across_channels(const LrnProblem& p, const float* input, float* output) {
  const int64_t pixels = p.h * p.w, blocks = (pixels + kPixels - 1) / kPixels;
  const float factor = p.alpha / static_cast<float>(p.size);
  parallel_for(p.n * blocks, p.threads, [&](int64_t item, int) {
    const int64_t n = item / blocks, first = item % blocks * kPixels;
    const int64_t count = std::min(kPixels, pixels - first);
    const float* in = input + n * p.c * pixels + first;
    float* out = output + n * p.c * pixels + first;
    float scale[kPixels];
    for (int64_t c = 0; c < p.c; ++c) {
      std::fill_n(scale, count, 0.0F);
      const WindowRange near(c - p.size / 2, p.size, p.c);
      for (int64_t j = near.begin; j < near.end; ++j)
        for (int64_t i = 0; i < count; ++i) scale[i] += in[j * pixels + i] * in[j * pixels + i];
      for (int64_t i = 0; i < count; ++i) scale[i] = p.k + factor * scale[i];
      normalize(in + c * pixels, scale, count, p.beta, out + c * pixels);
    }
  });
}

void lrn_across_channels_reference(const LrnProblem& p, const float* input, float* output) {
  const int64_t pixels = p.h * p.w;
  for (int64_t n = 0; n < p.n; ++n)
    for (int64_t c = 0; c < p.c; ++c)
      for (int64_t i = 0; i < pixels; ++i) {
        double sum = 0;
        for (int64_t j = c - p.size / 2; j <= c + p.size / 2; ++j)
          if (j >= 0 && j < p.c)
            sum += std::pow(static_cast<double>(input[(n * p.c + j) * pixels + i]), 2);
        const double scale = p.k + p.alpha / static_cast<double>(p.size) * sum;
        const int64_t at = (n * p.c + c) * pixels + i;
        output[at] = static_cast<float>(input[at] * std::pow(scale, -static_cast<double>(p.beta)));
      }
}

void lrn_within_channel(const LrnProblem& p, const float* input, float* output) {
  const auto area = static_cast<float>(p.size * p.size);
  parallel_for(p.n * p.c * p.h, p.threads, [&](int64_t item, int) {
    const int64_t plane = item / p.h, y = item % p.h;
    const float* image = input + plane * p.h * p.w;
    const WindowRange rows(y - p.size / 2, p.size, p.h);
    for (int64_t x = 0; x < p.w; ++x) {
      const WindowRange columns(x - p.size / 2, p.size, p.w);
      float sum = 0;
      for (int64_t iy = rows.begin; iy < rows.end; ++iy)
        for (int64_t ix = columns.begin; ix < columns.end; ++ix)
          sum += image[iy * p.w + ix] * image[iy * p.w + ix];
      const float scale = 1 + p.alpha * (sum / area);
      output[item * p.w + x] = image[y * p.w + x] * std::pow(scale, -p.beta);
    }
  });
}

}  // namespace revisit::engine
