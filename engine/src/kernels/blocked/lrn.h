#pragma once

#include "kernels/lrn.h"
#include "kernels/pooling.h"

namespace revisit::engine {

/// Like lrn_across_channels(), for NCHWc. `scratch` has blocked_lrn_scratch_floats() floats.
void blocked_lrn(const LrnProblem& p, const void* input, void* output, float* scratch);
int64_t blocked_lrn_scratch_floats(const LrnProblem& p);

/// blocked_lrn() fused with blocked_max_pool(), bitwise equal, except that bfloat16 values in
/// between are not rounded. `pooling` must have the planes, size and threads of `lrn`.
void blocked_lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& pooling, const void* input,
                          void* output, float* scratch);
int64_t blocked_lrn_max_pool_scratch_floats(const LrnProblem& lrn, const PoolingProblem& pooling);

}  // namespace revisit::engine
