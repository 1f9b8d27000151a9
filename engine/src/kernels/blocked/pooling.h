#pragma once

#include "kernels/pooling.h"

namespace revisit::engine {

/// Like max_pool() and average_pool(), bitwise equal (rounded to `p.values`), for NCHWc and without
/// a mask: `p.planes` is n * channels.
void blocked_max_pool(const PoolingProblem& p, int64_t channels, const void* input, void* output);
void blocked_average_pool(const PoolingProblem& p, int64_t channels, const void* input,
                          void* output);

}  // namespace revisit::engine
