#pragma once

#include "kernels/pooling.h"

namespace revisit::engine {

/// As max_pool() and average_pool(), the same bits (of `p.values`: rounded), on blocked values
/// without a mask: `p.planes` is n * channels.
void blocked_max_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output);
void blocked_average_pool(const PoolingProblem& p, int64_t channels, const void* input,
                          void* output);

}  // namespace revisit::engine
