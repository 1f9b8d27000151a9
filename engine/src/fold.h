#pragma once

#include "form.h"

namespace revisit::engine {

/// Sizes of the weights of a convolution, `[c_out][c_in][taps]`, c_in being that of one group.
struct WeightSize {
  int64_t c_out = 1, c_in = 1, taps = 1;
};

/// Weights and bias of a convolution after the parts of a Fusion that they can take.
struct FoldedWeights {
  std::vector<float> weights;  // [c_out][c_in, or the channels of the gray input][taps]
  std::vector<float> bias;     // [c_out]
};

/// How many channels a gray input must have for a convolution: the picture itself, and where
/// padding meets channels that differ by a constant, a second one that is 1 inside the image and,
/// by the padding, 0 outside. There the original sees 0 and not the constant.
int64_t gray_channels(const Fusion& fusion, bool padded);

/// Computed in double precision. `bias` may be null. `channels` is what gray_channels() says, or 0
/// when the fusion has no gray input.
FoldedWeights fold(const Fusion& fusion, const WeightSize& size, int64_t channels,
                   const float* weights, const float* bias);

}  // namespace revisit::engine
