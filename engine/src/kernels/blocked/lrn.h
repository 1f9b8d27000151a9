#pragma once

#include "kernels/lrn.h"
#include "kernels/pooling.h"

namespace revisit::engine {

/// As lrn_across_channels(), on blocked values. `scratch`: blocked_lrn_scratch_floats() of them.
void blocked_lrn(const LrnProblem& p, const void* input, void* output, float* scratch);
int64_t blocked_lrn_scratch_floats(const LrnProblem& p);

/// blocked_lrn() and then blocked_max_pool(), the same bits, without writing out what is between.
/// `pooling` has the planes, size and threads of `lrn`. In bf16 what is between is not rounded.
void blocked_lrn_max_pool(const LrnProblem& lrn, const PoolingProblem& pooling, const void* input,
                          void* output, float* scratch);
int64_t blocked_lrn_max_pool_scratch_floats(const LrnProblem& lrn, const PoolingProblem& pooling);

}  // namespace revisit::engine
