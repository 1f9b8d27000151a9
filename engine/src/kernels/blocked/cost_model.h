#pragma once

#include "kernels/blocked/winograd_shape.h"

namespace revisit::engine {

double winograd_ms(const WinogradVariant& v, const ConvolutionProblem& p);

}  // namespace revisit::engine
