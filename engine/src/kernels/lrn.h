#pragma once

#include <cstdint>

#include "revisit/engine/tensor.h"

namespace revisit::engine {

/// Local response normalization of `[n][c][h * w]` over `size` (odd) neighboring channels:
/// y = x * (k + alpha / size * sum of squares) ^ -beta (docs/LAYERS.md point 4).
struct LrnProblem {
  int64_t n = 1, c = 1, h = 1, w = 1;
  int64_t size = 5;
  float alpha = 1, beta = 0.75F, k = 1;
  int threads = 1;
  Precision values = Precision::kFloat32;  // NCHWc arrays
};

void lrn_across_channels(const LrnProblem& problem, const float* input, float* output);
void lrn_across_channels_reference(const LrnProblem& problem, const float* input, float* output);

/// LRN over a `size` x `size` window of each plane, with zero padding that counts in the mean: y =
/// x * (1 + alpha * mean of squares) ^ -beta. `k` is not used, as in Caffe.
void lrn_within_channel(const LrnProblem& problem, const float* input, float* output);

}  // namespace revisit::engine
