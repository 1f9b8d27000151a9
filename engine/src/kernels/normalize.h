#pragma once

#include <cstdint>

namespace revisit::engine {

/// Division by the L2 norm, of images `[n][c][pixels]`: y = x / sqrt(eps + sum of x^2) * scale. The
/// sum is over the channels of a pixel, or over the whole image when `across_spatial`. `scale` is
/// one number a channel, or one for all when `channel_shared`.
struct NormalizeProblem {
  int64_t n = 1, c = 1, pixels = 1;
  bool across_spatial = true, channel_shared = true;
  float eps = 1e-10F;
  int threads = 1;
};
void normalize(const NormalizeProblem& problem, const float* input, const float* scale,
               float* output);

}  // namespace revisit::engine
