#pragma once

#include "form.h"

namespace revisit::engine {

/// Sizes of the weights of a convolution, `[c_out][c_in][taps]`, c_in being that of one group.
struct WeightSize {
  int64_t c_out = 1, c_in = 1, taps = 1;
};

/// Weights and bias of a convolution after the parts of a Fusion that they can take.
struct FoldedWeights {
  std::vector<float> weights;  // [c_out][c_in; one channel of a gray input][taps]
  std::vector<float> bias;     // [c_out]
  /// What the offsets of a gray input add for each tap inside the image, [c_out][taps]. Empty where
  /// no tap is ever outside: then the bias has their sum. Padding is 0 in every channel of the
  /// original, not the offset.
  std::vector<float> constants;
};

/// Whether padding meets channels of a gray input that are not all the same.
bool needs_constants(const Fusion& fusion, bool padded);

/// Computed in double precision. `bias` may be null.
FoldedWeights fold(const Fusion& fusion, const WeightSize& size, bool padded, const float* weights,
                   const float* bias);

}  // namespace revisit::engine
