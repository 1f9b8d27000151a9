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

bool changes_weights(const Fusion& fusion) {
  return fusion.gray_offsets || fusion.affine;
}

}  // namespace

FusedConvolution::FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion,
                                   const float* weights, const float* bias)
    : problem_(problem),
      fusion_(fusion),
      weight_size_{problem.c_out, problem.c_in_per_group(), problem.kernel_h * problem.kernel_w},
      sees_outside_(problem.pad_h > 0 || problem.pad_w > 0 ||
                    (problem.kernel_h - 1) * problem.dilation_h >= problem.h ||
                    (problem.kernel_w - 1) * problem.dilation_w >= problem.w),
      weights_(weights),
      bias_(bias) {
  if (fusion.gray_offsets) problem_.c_in = 1;
}

int64_t FusedConvolution::packed_floats(const BlockedConvolutionKernel& kernel) const {
  return (has_constants() ? 2 : 1) * kernel.packed_floats(problem_) +
         padded_channels(problem_.c_out);
}

PackedWeightsKey FusedConvolution::key(size_t layer, std::string kernel) const {
  PackedWeightsKey key{layer, fusion_.affine_layers, {}, has_constants(), std::move(kernel)};
  if (fusion_.gray_offsets)
    for (const float offset : *fusion_.gray_offsets)
      key.gray_offsets.push_back(std::bit_cast<uint32_t>(offset));
  return key;
}

std::shared_ptr<const PackedWeights> FusedConvolution::pack(const BlockedConvolutionKernel& kernel,
                                                            const Binding& binding) const {
  if (!weights_) return nullptr;
  return binding.cache->get(key(binding.layer, kernel.name), [&] {
    const int64_t lanes = padded_channels(problem_.c_out);
    PackedWeights packed{AlignedFloats(kernel.packed_floats(problem_)), {}};
    if (!changes_weights(fusion_)) {
      kernel.pack(problem_, weights_, packed.weights.data());
      packed.bias =
          padded(std::span(bias_, static_cast<size_t>(bias_ ? problem_.c_out : 0)), lanes);
      return packed;
    }
    FoldedWeights f = folded();
    kernel.pack(problem_, f.weights.data(), packed.weights.data());
    packed.bias = padded(f.bias, lanes);
    if (has_constants()) pack_constants(kernel, problem_, std::move(f.constants), &packed);
    return packed;
  });
}

FusedConvolution::Plain FusedConvolution::plain(const Binding& binding) const {
  if (!changes_weights(fusion_)) return {weights_, bias_, nullptr, 0};
  const int64_t floats = problem_.c_out * ((has_constants() ? 2 : 1) * problem_.depth() + 1);
  if (!weights_) return {nullptr, nullptr, nullptr, floats};
  auto owner = binding.cache->get(key(binding.layer, ""), [&] {
    FoldedWeights f = folded();
    if (has_constants()) f.weights = with_constants(f, problem_.c_out);
    return PackedWeights{padded(f.weights, static_cast<int64_t>(f.weights.size())),
                         padded(f.bias, static_cast<int64_t>(f.bias.size()))};
  });
  const float *weights = owner->weights.data(), *bias = owner->bias.data();
  return {weights, bias, std::move(owner), floats};
}

}  // namespace revisit::engine
