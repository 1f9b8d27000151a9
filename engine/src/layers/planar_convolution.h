#pragma once

#include "kernels/convolution.h"
#include "layer.h"

namespace revisit::engine {

/// The kernel for a 2-D convolution of one or more inputs and what is fused with it: a blocked one
/// where the planner wants those and one pays, else one on plain values. `bias` may be null.
Kernel bind_planar_convolution(const ConvolutionProblem& problem, const Binding& binding,
                               const float* weights, const float* bias);

/// Whether that kernel reads a plain input and writes a blocked output, when there is nothing but
/// the input in plain layout: only that one can take pooling, too.
bool takes_plain_input(const ConvolutionProblem& problem, const Fusion& fusion);

}  // namespace revisit::engine
