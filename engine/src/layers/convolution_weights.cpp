#include "layers/convolution_weights.h"

#include <bit>
#include <numeric>

namespace revisit::engine {
namespace {

/// Where a tap is outside the image its constant is not to be there: the bias has all of them.
void pack_constants(const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p,
                    std::vector<float> constants, PackedWeights* packed) {
  const auto taps = static_cast<int64_t>(constants.size()) / p.c_out;
  for (int64_t co = 0; co < p.c_out; ++co)
    packed->bias.data()[co] = static_cast<float>(
        std::accumulate(constants.begin() + co * taps, constants.begin() + (co + 1) * taps,
                        double{packed->bias.data()[co]}));
  for (float& constant : constants) constant = -constant;
  packed->outside = AlignedFloats(kernel.packed_floats(p));
  kernel.pack(p, constants.data(), packed->outside.data());
}

/// Weights of each output channel followed by its constants: those of a second input channel.
std::vector<float> with_constants(const FoldedWeights& folded, int64_t c_out) {
  const auto taps = static_cast<int64_t>(folded.constants.size()) / c_out;
  std::vector<float> result;
  for (int64_t co = 0; co < c_out; ++co)
    for (const std::vector<float>* part : {&folded.weights, &folded.constants})
      result.insert(result.end(), part->begin() + co * taps, part->begin() + (co + 1) * taps);
  return result;
}

const float* bias_of(const std::vector<Tensor>& originals) {
  return originals.size() > 1 ? originals[1].values.data() : nullptr;
}

HeldWeights held(std::shared_ptr<const PackedWeights> packed) {
  const float *weights = packed->weights.data(), *bias = packed->bias.data(),
              *outside = packed->outside.data();
  return {weights, bias, outside, std::move(packed)};
}

}  // namespace

FusedConvolution::FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion)
    : problem_(problem),
      fusion_(fusion),
      weight_size_{problem.c_out, problem.c_in_per_group(), problem.kernel_h * problem.kernel_w},
      sees_outside_(problem.pad_h > 0 || problem.pad_w > 0 ||
                    (problem.kernel_h - 1) * problem.dilation_h >= problem.h ||
                    (problem.kernel_w - 1) * problem.dilation_w >= problem.w) {
  if (fusion.gray_offsets) problem_.c_in = 1;
}

int64_t FusedConvolution::packed_floats(const BlockedConvolutionKernel& kernel) const {
  return (has_constants() ? 2 : 1) * kernel.packed_floats(problem_) +
         padded_channels(problem_.c_out);
}

int64_t FusedConvolution::most_packed_floats(int64_t limit) const {
  return (limit - padded_channels(problem_.c_out)) / (has_constants() ? 2 : 1);
}

PackedWeightsKey FusedConvolution::key(size_t layer, std::string kernel) const {
  PackedWeightsKey key{layer, fusion_.affine_layers, {}, has_constants(), std::move(kernel)};
  if (fusion_.gray_offsets)
    for (const float offset : *fusion_.gray_offsets)
      key.gray_offsets.push_back(std::bit_cast<uint32_t>(offset));
  return key;
}

FoldedWeights FusedConvolution::folded(const std::vector<Tensor>& originals) const {
  return fold(fusion_, weight_size_, sees_outside_, originals[0].values.data(), bias_of(originals));
}

HeldWeights FusedConvolution::packed(const BlockedConvolutionKernel& kernel,
                                     const WeightSource& source) const {
  return held(source.cache->get(key(source.layer, kernel.name), [&] {
    const auto originals = source.originals();
    const int64_t lanes = padded_channels(problem_.c_out);
    PackedWeights packed{AlignedFloats(kernel.packed_floats(problem_)), {}};
    if (!fusion_.gray_offsets && !fusion_.affine) {
      const float* bias = bias_of(*originals);
      kernel.pack(problem_, (*originals)[0].values.data(), packed.weights.data());
      packed.bias = padded(std::span(bias, static_cast<size_t>(bias ? problem_.c_out : 0)), lanes);
      return packed;
    }
    FoldedWeights f = folded(*originals);
    kernel.pack(problem_, f.weights.data(), packed.weights.data());
    packed.bias = padded(f.bias, lanes);
    if (has_constants()) pack_constants(kernel, problem_, std::move(f.constants), &packed);
    return packed;
  }));
}

int64_t FusedConvolution::plain_floats() const {
  return fusion_.gray_offsets ? problem_.c_out * ((has_constants() ? 2 : 1) * problem_.depth() + 1)
                              : 0;
}

HeldWeights FusedConvolution::plain(const WeightSource& source) const {
  if (!fusion_.gray_offsets) {
    auto originals = source.originals();
    const float *weights = (*originals)[0].values.data(), *bias = bias_of(*originals);
    return {weights, bias, nullptr, std::move(originals)};
  }
  return held(source.cache->get(key(source.layer, ""), [&] {
    FoldedWeights f = folded(*source.originals());
    if (has_constants()) f.weights = with_constants(f, problem_.c_out);
    return PackedWeights{padded(f.weights, static_cast<int64_t>(f.weights.size())),
                         padded(f.bias, static_cast<int64_t>(f.bias.size()))};
  }));
}

}  // namespace revisit::engine
