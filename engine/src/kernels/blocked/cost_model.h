#pragma once

#include "kernels/blocked/winograd_shape.h"

namespace revisit::engine {

double plain_input_ms(const ConvolutionProblem& p);
double depthwise_ms(const ConvolutionProblem& p);
double pointwise_ms(const ConvolutionProblem& p);
double direct_ms(const ConvolutionProblem& p);
double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p);

}  // namespace revisit::engine
