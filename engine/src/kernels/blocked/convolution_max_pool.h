#pragma once

#include "kernels/blocked/convolution.h"
#include "kernels/lrn.h"
#include "kernels/pooling.h"

namespace revisit::engine {

/// First layers of a net, fused: a convolution of few channels with its epilogue, an optional
/// blocked_lrn(), then blocked_max_pool(). Values in between, the largest of these nets, stay in
/// cache and in float32. Results are bitwise equal to separate kernels, except for bfloat16 with
/// LRN, where the convolution's output is not rounded.
struct ConvolutionMaxPool {
  ConvolutionProblem convolution;   // supported by kBlockedPlainInput or, with `in_tiles`, by
                                    // kBlockedPlainInputTiles; defines the threads
  const LrnProblem* lrn = nullptr;  // follows the convolution; or null
  PoolingProblem pooling;
  bool in_tiles = false;
};

/// `arguments` are those of the convolution, without addend; the output is that of the pooling.
void blocked_convolution_max_pool(const ConvolutionMaxPool& p,
                                  const BlockedConvolutionArguments& arguments);
int64_t blocked_convolution_max_pool_scratch_floats(const ConvolutionMaxPool& p);

}  // namespace revisit::engine
