#pragma once

#include "kernels/blocked/convolution.h"
#include "kernels/lrn.h"
#include "kernels/pooling.h"

namespace revisit::engine {

/// The first layers of a net as one: a convolution of few channels with its epilogue, then
/// blocked_lrn() where there is one, then blocked_max_pool(). The values
/// between them, the largest of these nets, stay in cache and in float32: the same bits, but in
/// bfloat16 with LRN, where the convolution's output is not rounded.
struct ConvolutionMaxPool {
  ConvolutionProblem convolution;   // that `in_tiles` or else kBlockedPlainInput supports; its
                                    // threads count
  const LrnProblem* lrn = nullptr;  // of the convolution's output; or null
  PoolingProblem pooling;           // of the convolution's output
  bool in_tiles = false;            // as kBlockedPlainInputTiles
};

/// `arguments` as of the convolution, without addend; the output is that of the pooling.
void blocked_convolution_max_pool(const ConvolutionMaxPool& p,
                                  const BlockedConvolutionArguments& arguments);
int64_t blocked_convolution_max_pool_scratch_floats(const ConvolutionMaxPool& p);

}  // namespace revisit::engine
