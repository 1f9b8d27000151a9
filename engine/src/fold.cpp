#include "fold.h"

#include <algorithm>

namespace revisit::engine {
namespace {

using Doubles = std::vector<double>;

/// Sums over the input channels: of the weights for the picture, of weights times offsets for what
/// the channels are beyond the picture.
Doubles fold_gray(const std::vector<float>& offsets, const WeightSize& size, int64_t channels,
                  const float* weights, Doubles* bias) {
  Doubles folded(size.c_out * channels * size.taps, 0.0);
  for (int64_t co = 0; co < size.c_out; ++co)
    for (int64_t ci = 0; ci < size.c_in; ++ci)
      for (int64_t k = 0; k < size.taps; ++k) {
        const double weight = weights[(co * size.c_in + ci) * size.taps + k];
        double* const picture = &folded[co * channels * size.taps];
        picture[k] += weight;
        const double constant = weight * offsets[ci];
        if (channels == 2)
          picture[size.taps + k] += constant;
        else
          (*bias)[co] += constant;
      }
  return folded;
}

}  // namespace

int64_t gray_channels(const Fusion& fusion, bool padded) {
  if (!fusion.gray_offsets) return 0;
  const std::vector<float>& offsets = *fusion.gray_offsets;
  const bool equal = std::all_of(offsets.begin(), offsets.end(), [](float o) { return o == 0; });
  return padded && !equal ? 2 : 1;
}

FoldedWeights fold(const Fusion& fusion, const WeightSize& size, int64_t channels,
                   const float* weights, const float* bias) {
  Doubles b(size.c_out, 0.0);
  if (bias) std::copy_n(bias, size.c_out, b.begin());
  Doubles w = channels > 0 ? fold_gray(*fusion.gray_offsets, size, channels, weights, &b)
                           : Doubles(weights, weights + size.c_out * size.c_in * size.taps);
  if (fusion.affine) {
    const auto per_output = static_cast<int64_t>(w.size()) / size.c_out;
    for (int64_t co = 0; co < size.c_out; ++co) {
      const double scale = fusion.affine->scale[co];
      for (int64_t i = 0; i < per_output; ++i) w[co * per_output + i] *= scale;
      b[co] = b[co] * scale + fusion.affine->shift[co];
    }
  }
  return {{w.begin(), w.end()}, {b.begin(), b.end()}};
}

}  // namespace revisit::engine
