#pragma once

#include "kernels/pooling.h"

namespace revisit::engine {

/// As max_pool() and average_pool(), the same bits, on blocked values without a mask: `p.planes` is
/// n * channels.
void blocked_max_pool(const PoolingProblem& p, int64_t channels, const float* input, float* output);
void blocked_average_pool(const PoolingProblem& p, int64_t channels, const float* input,
                          float* output);

}  // namespace revisit::engine
