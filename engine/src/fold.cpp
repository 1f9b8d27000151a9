#include "fold.h"

#include <algorithm>

namespace revisit::engine {
namespace {

using Doubles = std::vector<double>;

/// Sums of `[c_out][c_in][taps]` over c_in, each channel times its factor.
Doubles sum_of_channels(const WeightSize& size, const float* weights, const Doubles& factors) {
  Doubles sums(size.c_out * size.taps, 0.0);
  for (int64_t co = 0; co < size.c_out; ++co)
    for (int64_t ci = 0; ci < size.c_in; ++ci)
      for (int64_t k = 0; k < size.taps; ++k)
        sums[co * size.taps + k] += factors[ci] * weights[(co * size.c_in + ci) * size.taps + k];
  return sums;
}

/// Multiplies each output channel, `values` being [c_out][...].
void scale_outputs(const Doubles& factors, Doubles* values) {
  const size_t run = values->size() / factors.size();
  for (size_t i = 0; i < values->size(); ++i) (*values)[i] *= factors[i / run];
}

std::vector<float> rounded(const Doubles& values) {
  return {values.begin(), values.end()};
}

}  // namespace

bool needs_constants(const Fusion& fusion, bool padded) {
  return padded && fusion.gray_offsets &&
         std::any_of(fusion.gray_offsets->begin(), fusion.gray_offsets->end(),
                     [](float offset) { return offset != 0; });
}

FoldedWeights fold(const Fusion& fusion, const WeightSize& size, bool padded, const float* weights,
                   const float* bias) {
  Doubles w(weights, weights + size.c_out * size.c_in * size.taps);
  Doubles b(size.c_out, 0.0), constants;
  if (bias) std::copy_n(bias, size.c_out, b.begin());
  if (const auto& offsets = fusion.gray_offsets) {
    w = sum_of_channels(size, weights, Doubles(size.c_in, 1.0));
    constants = sum_of_channels(size, weights, Doubles(offsets->begin(), offsets->end()));
    if (!needs_constants(fusion, padded)) {
      for (size_t i = 0; i < constants.size(); ++i) b[i / size.taps] += constants[i];
      constants.clear();
    }
  }
  if (fusion.affine) {
    scale_outputs(fusion.affine->scale, &w);
    scale_outputs(fusion.affine->scale, &constants);
    for (int64_t co = 0; co < size.c_out; ++co)
      b[co] = b[co] * fusion.affine->scale[co] + fusion.affine->shift[co];
  }
  return {rounded(w), rounded(b), rounded(constants)};
}

}  // namespace revisit::engine
