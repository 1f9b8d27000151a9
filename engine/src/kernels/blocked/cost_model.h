#pragma once

#include "kernels/blocked/winograd_shape.h"

namespace revisit::engine {
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
