#pragma once

#include "kernels/blocked/convolution.h"
#include "layer.h"

namespace revisit::engine {

/// The blocked kernel for a 2-D convolution with its fusion, whose input is in this layout; null
/// where none pays or keeps to the limits: then a kernel on plain values takes it, which can do all
/// of a fusion but pooling. To be asked once for an operation: what else is planned depends on the
/// answer.
const BlockedConvolutionKernel* choose_convolution(const ConvolutionProblem& problem,
                                                   const Fusion& fusion, Layout input,
                                                   const ConvolutionLimits& limits);

/// What that kernel packs [floats].
int64_t packed_floats(const ConvolutionProblem& problem, const Fusion& fusion,
                      const BlockedConvolutionKernel& kernel);

/// The kernel for a 2-D convolution of one or more inputs and what is fused with it:
/// Binding::convolution, or one on plain values. Its weights are held, not bound.
Kernel bind_planar_convolution(const ConvolutionProblem& problem, const Binding& binding);

}  // namespace revisit::engine
