#include <algorithm>
#include <bit>
#include <numeric>

#include "layers/convolution.h"

namespace revisit::engine {
namespace {

using Doubles = std::vector<double>;

/// Sums `[c_out][c_in][taps]` over the input channels, each multiplied by its factor.
Doubles sum_of_channels(int64_t c_out, const Doubles& factors, const Doubles& weights) {
  const auto c_in = static_cast<int64_t>(factors.size());
  const int64_t taps = static_cast<int64_t>(weights.size()) / (c_out * c_in);
  Doubles sums(c_out * taps, 0.0);
  for (int64_t co = 0; co < c_out; ++co)
    for (int64_t ci = 0; ci < c_in; ++ci)
      for (int64_t k = 0; k < taps; ++k)
        sums[co * taps + k] += factors[ci] * weights[(co * c_in + ci) * taps + k];
  return sums;
}

void scale_outputs(const Doubles& factors, Doubles* values) {
  const size_t run = values->size() / factors.size();
  for (size_t i = 0; i < values->size(); ++i) (*values)[i] *= factors[i / run];
}

std::vector<float> rounded(const Doubles& values) {
  return {values.begin(), values.end()};
}

ConvolutionProblem in_float32(ConvolutionProblem p) {
  p.values = Precision::kFloat32;
  return p;
}

/// The bias includes the constants of all taps; `outside_taps` subtracts those outside the image.
void pack_constants(const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p,
                    std::vector<float> constants, PackedWeights* packed) {
  const auto taps = static_cast<int64_t>(constants.size()) / p.c_out;
  for (int64_t co = 0; co < p.c_out; ++co)
    packed->bias.data()[co] = static_cast<float>(
        std::accumulate(constants.begin() + co * taps, constants.begin() + (co + 1) * taps,
                        double{packed->bias.data()[co]}));
  for (float& constant : constants) constant = -constant;
  packed->outside_taps = AlignedFloats(kernel.packed_floats(in_float32(p)));
  kernel.pack(in_float32(p), constants.data(), packed->outside_taps.data());
}

bool reaches_beyond_image(const ConvolutionProblem& p) {
  return p.pad_h > 0 || p.pad_w > 0 || (p.kernel_h - 1) * p.dilation_h >= p.h ||
         (p.kernel_w - 1) * p.dilation_w >= p.w;
}

}  // namespace

const float* bias_of(const std::vector<Tensor>& originals) {
  return originals.size() > 1 ? originals[1].values.data() : nullptr;
}

FusedConvolution::FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion)
    : problem_(problem),
      fusion_(fusion),
      c_in_(problem.c_in_per_group()),
      has_constants_(fusion.channel_offsets && reaches_beyond_image(problem) &&
                     std::any_of(fusion.channel_offsets->begin(), fusion.channel_offsets->end(),
                                 [](float offset) { return offset != 0; })) {
  if (fusion.channel_offsets) problem_.c_in = 1;
}

Bytes FusedConvolution::packed_size(const BlockedConvolutionKernel& kernel) const {
  return floats(kernel.packed_floats(problem_) +
                (has_constants_ ? kernel.packed_floats(in_float32(problem_)) : 0) +
                padded_channels(problem_.c_out));
}

PackedWeightsKey FusedConvolution::key(size_t layer, std::string kernel) const {
  PackedWeightsKey key{layer,          fusion_.affine_layers, {},
                       has_constants_, std::move(kernel),     problem_.values};
  if (fusion_.channel_offsets)
    for (const float offset : *fusion_.channel_offsets)
      key.channel_offsets.push_back(std::bit_cast<uint32_t>(offset));
  return key;
}

HeldWeights FusedConvolution::packed(const BlockedConvolutionKernel& kernel,
                                     const std::vector<Tensor>& originals, WeightCache* cache,
                                     size_t layer) const {
  const auto all = cache->get(key(layer, kernel.name), [&] { return pack(kernel, originals); });
  return {all->weights.data(), all->bias.data(), all->outside_taps.data(), all};
}

/// Folds fused operations into the weights, in double precision.
PackedWeights FusedConvolution::pack(const BlockedConvolutionKernel& kernel,
                                     const std::vector<Tensor>& originals) const {
  const int64_t c_out = problem_.c_out, lanes = padded_channels(c_out);
  const std::vector<float>& weights = originals[0].values;
  const float* const bias = bias_of(originals);
  PackedWeights packed{AlignedFloats(kernel.packed_floats(problem_)), {}};
  if (!fusion_.channel_offsets && !fusion_.affine) {
    kernel.pack(problem_, weights.data(), packed.weights.data());
    packed.bias = padded(std::span(bias, static_cast<size_t>(bias ? c_out : 0)), lanes);
    return packed;
  }
  Doubles w(weights.begin(), weights.end()), b(c_out, 0.0);
  Doubles constants;  // contribution of a single-channel input's offsets per tap, [c_out][taps]
  if (bias) std::copy_n(bias, c_out, b.begin());
  if (const auto& offsets = fusion_.channel_offsets) {
    constants = sum_of_channels(c_out, Doubles(offsets->begin(), offsets->end()), w);
    w = sum_of_channels(c_out, Doubles(c_in_, 1.0), w);
    const int64_t taps = static_cast<int64_t>(constants.size()) / c_out;
    if (!has_constants_) {
      for (size_t i = 0; i < constants.size(); ++i) b[i / taps] += constants[i];
      constants.clear();
    }
  }
  if (fusion_.affine) {
    scale_outputs(fusion_.affine->scale, &w);
    scale_outputs(fusion_.affine->scale, &constants);
    for (int64_t co = 0; co < c_out; ++co)
      b[co] = b[co] * fusion_.affine->scale[co] + fusion_.affine->shift[co];
  }
  kernel.pack(problem_, rounded(w).data(), packed.weights.data());
  packed.bias = padded(rounded(b), lanes);
  if (has_constants_) pack_constants(kernel, problem_, rounded(constants), &packed);
  return packed;
}

}  // namespace revisit::engine
