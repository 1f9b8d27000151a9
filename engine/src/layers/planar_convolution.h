#pragma once

#include "kernels/blocked/convolution.h"
#include "kernels/convolution_nd.h"
#include "layer.h"

namespace revisit::engine {

/// The blocked kernel for a 2-D convolution with its fusion, whose input is in this layout. Null
/// where none of at most so many transform points pays: a kernel on plain values can do all of a
/// fusion but pooling. To be asked once for an operation: other plans depend on the answer.
const BlockedConvolutionKernel* choose_convolution(const ConvolutionProblem& problem,
                                                   const Fusion& fusion, Layout input,
                                                   int most_points);

/// Binding::convolution for the inputs, with all that is fused. Its weights are held, not bound.
Kernel bind_blocked_convolution(ConvolutionProblem problem, const Binding& binding);

/// `chosen` with the weights of the layer. Of a gray input it writes out all channels: it is for
/// the few convolutions that no blocked kernel takes.
Kernel bind_plain_convolution(const ConvolutionNdProblem& problem,
                              const ConvolutionNdKernel& chosen, const Binding& binding);

}  // namespace revisit::engine
