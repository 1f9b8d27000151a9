#pragma once

#include "bfloat16.h"
#include "kernels/blocked/kernels.h"
#include "kernels/blocked/partition.h"
#include "kernels/window.h"

namespace revisit::engine {

extern const BlockedConvolutionKernel kBlockedPlainInput;
extern const BlockedConvolutionKernel kBlockedPlainInputTiles;
extern const BlockedConvolutionKernel kBlockedDepthwise;
extern const BlockedConvolutionKernel kBlockedNarrowGroups;
extern const BlockedConvolutionKernel kBlockedPointwise;
extern const BlockedConvolutionKernel kBlockedDirect;
extern const BlockedConvolutionKernel kBlockedTiles;
std::span<const BlockedConvolutionKernel> winograd_kernels();

inline bool groups_are_whole_blocks(const ConvolutionProblem& p) {
  return p.group == 1 || (p.c_in_per_group() % kLanes == 0 && p.c_out_per_group() % kLanes == 0);
}

/// Passes `packed` as numbers of type `values` and the conversion from float.
template <class Pack>
void pack_as(Precision values, float* packed, const Pack& pack) {
  if (values == Precision::kBf16)
    pack(reinterpret_cast<BFloat16*>(packed), to_bfloat16);
  else
    pack(packed, [](float x) { return x; });
}

inline bool is_pointwise(const ConvolutionProblem& p) {
  return groups_are_whole_blocks(p) && is_each_pixel(p.kernel_h, p.stride_h, p.pad_h) &&
         is_each_pixel(p.kernel_w, p.stride_w, p.pad_w);
}

// Predicted times of the kernels on one thread, from counts of operations and bytes. The constants
// are for an AVX-512 core at 3.4 GHz with 2 MB of L2 cache (Sapphire Rapids), fitted to measured
// times of the layers in tests/problems/convolution.txt.
double plain_input_ms(const ConvolutionProblem& p);
double plain_input_tiles_ms(const ConvolutionProblem& p);
double depthwise_ms(const ConvolutionProblem& p);
double pointwise_ms(const ConvolutionProblem& p);
double direct_ms(const ConvolutionProblem& p);
double tiles_ms(const ConvolutionProblem& p);
double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p);

}  // namespace revisit::engine
