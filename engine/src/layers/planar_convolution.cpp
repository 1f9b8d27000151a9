#include <algorithm>
#include <bit>
#include <numeric>
#include <stdexcept>

#include "kernels/blocked/kernels.h"
#include "layers/convolution.h"
#include "weight_cache.h"

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
  const auto last = [](int64_t windows, int64_t stride, int64_t kernel, int64_t dilation) {
    return (windows - 1) * stride + (kernel - 1) * dilation;
  };
  return p.pad_h > 0 || p.pad_w > 0 || last(p.out_h, p.stride_h, p.kernel_h, p.dilation_h) >= p.h ||
         last(p.out_w, p.stride_w, p.kernel_w, p.dilation_w) >= p.w;
}

const float* bias_of(const std::vector<Tensor>& originals) {
  return originals.size() > 1 ? originals[1].values.data() : nullptr;
}

/// A convolution with its fused operations.
class FusedConvolution {
 public:
  FusedConvolution(const ConvolutionProblem& problem, const Fusion& fusion)
      : problem_(problem),
        fusion_(fusion),
        c_in_(problem.c_in_per_group()),
        has_constants_(fusion.channel_offsets && reaches_beyond_image(problem) &&
                       std::any_of(fusion.channel_offsets->begin(), fusion.channel_offsets->end(),
                                   [](float offset) { return offset != 0; })) {
    if (fusion.channel_offsets) problem_.c_in = 1;
  }

  /// Has one input channel if the input has a single channel.
  const ConvolutionProblem& problem() const { return problem_; }
  const Fusion& fusion() const { return fusion_; }

  Bytes packed_size(const BlockedConvolutionKernel& kernel) const {
    return floats(kernel.packed_floats(problem_) +
                  (has_constants_ ? kernel.packed_floats(in_float32(problem_)) : 0) +
                  padded_channels(problem_.c_out));
  }

  /// Returns the weights from `cache`, under `layer`, or packs the layer's weights.
  std::shared_ptr<const PackedWeights> packed(const BlockedConvolutionKernel& kernel,
                                              const std::vector<Tensor>& originals,
                                              WeightCache* cache, size_t layer) const {
    return cache->get(key(layer, kernel.name), [&] { return pack(kernel, originals); });
  }

 private:
  PackedWeightsKey key(size_t layer, std::string kernel) const {
    PackedWeightsKey key{layer,          fusion_.affine_layers, {},
                         has_constants_, std::move(kernel),     problem_.values};
    if (fusion_.channel_offsets)
      for (const float offset : *fusion_.channel_offsets)
        key.channel_offsets.push_back(std::bit_cast<uint32_t>(offset));
    return key;
  }

  /// Folds fused operations into the weights, in double precision.
  PackedWeights pack(const BlockedConvolutionKernel& kernel,
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

  ConvolutionProblem problem_;
  Fusion fusion_;
  int64_t c_in_;  // channels of the file's weights, per group
  /// True if windows of a single-channel input reach beyond the image, where all original channels
  /// are 0 instead of their offset.
  bool has_constants_;
};

/// Rejects kernels that are mostly padding, with many times the memory of NCHW kernels.
bool is_worth_blocking(const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
  constexpr int64_t kMaxExpansion = 16, kSmall = 4 << 20;
  const int64_t packed = kernel.packed_floats(p);
  return fills_blocks(p.c_out) &&
         (packed <= kSmall || packed / kMaxExpansion <= p.c_out * p.depth());
}

const BlockedConvolutionKernel* choose_for(const ConvolutionProblem& p, Layout input,
                                           int most_points) {
  const BlockedConvolutionKernel* const kernel = choose_blocked_convolution(p, input, most_points);
  return kernel && is_worth_blocking(*kernel, p) ? kernel : nullptr;
}

struct RunBlocked {
  ConvolutionProblem problem;
  const BlockedConvolutionKernel& chosen;
  std::optional<LrnProblem> lrn;
  std::optional<PoolingProblem> pooling;

  ConvolutionMaxPool with_pooling() const {
    return {problem, lrn ? &*lrn : nullptr, *pooling, chosen.products == Products::kTiles};
  }
  Precision products() const {
    return chosen.products == Products::kFloat32 ? Precision::kFloat32 : problem.values;
  }
  int64_t multiplications() const {
    return chosen.multiplications ? chosen.multiplications(problem) : problem.macs();
  }
  std::string name() const {
    std::string name = chosen.name;
    if (products() == Precision::kBf16) name += " bf16";
    if (lrn) name += " + lrn";
    if (pooling) name += " + max-pool";
    return name;
  }
  int64_t scratch_floats() const {
    return pooling ? blocked_convolution_max_pool_scratch_floats(with_pooling())
                   : chosen.scratch_floats(problem);
  }
  void operator()(const BlockedConvolutionArguments& arguments) const {
    if (pooling)
      blocked_convolution_max_pool(with_pooling(), arguments);
    else
      chosen.run(problem, arguments);
  }
};

const float* write_channels(const ConvolutionNdProblem& p, const std::vector<float>& offsets,
                            const float* picture, float* channels) {
  const int64_t pixels = p.image_pixels();
  float* out = channels;
  for (int64_t n = 0; n < p.n; ++n, picture += pixels)
    for (const float offset : offsets)
      out =
          std::transform(picture, picture + pixels, out, [offset](float x) { return x + offset; });
  return channels;
}

}  // namespace

const BlockedConvolutionKernel* choose_convolution(const ConvolutionProblem& problem,
                                                   const Fusion& fusion, Layout input,
                                                   int most_points) {
  const FusedConvolution convolution(problem, fusion);
  const ConvolutionProblem& p = convolution.problem();
  // Both need the NCHW input, even if another layer provides it in NCHWc.
  if (fusion.channel_offsets || fusion.pooling) return choose_for(p, Layout::kNchw, most_points);
  if (input == Layout::kNchw)
    if (const auto* kernel = choose_for(p, Layout::kNchw, most_points)) return kernel;
  return choose_for(p, Layout::kNChw16c, most_points);
}

Kernel bind_blocked_convolution(ConvolutionProblem problem, const Binding& binding) {
  problem.threads = binding.threads;
  problem.values = binding.precision;
  const FusedConvolution convolution(problem, binding.fusion);
  const BlockedConvolutionKernel& chosen = *binding.convolution;
  const Fusion& fusion = convolution.fusion();
  const RunBlocked run{convolution.problem(), chosen, fusion.lrn, fusion.pooling};
  Kernel kernel;
  kernel.name = run.name();
  const auto n_outputs = static_cast<int64_t>(binding.outputs.size());
  kernel.work = {.macs = n_outputs * problem.macs(),
                 .multiplications = n_outputs * run.multiplications(),
                 .products = run.products()};
  kernel.reads.assign(binding.inputs.size(), chosen.input);
  if (fusion.adds_last_input) kernel.reads.back() = Layout::kNChw16c;
  kernel.writes = Layout::kNChw16c;
  kernel.packed = convolution.packed_size(chosen);
  kernel.scratch = floats(run.scratch_floats());
  kernel.hold = [convolution, &chosen, &originals = binding.weights, cache = binding.cache,
                 layer = binding.layer] {
    return convolution.packed(chosen, originals, cache, layer);
  };
  kernel.run = [run, adds = fusion.adds_last_input,
                activation = fusion.activation](const Call& call) {
    const PackedWeights& weights = *call.weights;
    for (size_t i = 0; i < call.outputs.size(); ++i)
      run({call.inputs[i], weights.weights.data(), weights.bias.data(),
           adds ? call.inputs.back() : nullptr, activation.epilogue, call.outputs[i], call.scratch,
           weights.outside_taps.data()});
  };
  return kernel;
}

Kernel bind_nchw_convolution(const ConvolutionNdProblem& p, const ConvolutionNdKernel& chosen,
                             const Binding& binding) {
  const Fusion& fusion = binding.fusion;
  if (fusion.pooling) throw std::logic_error("an NCHW convolution cannot fuse pooling");
  const int64_t input_scratch = fusion.channel_offsets ? p.n * p.c_image * p.image_pixels() : 0;
  Kernel kernel;
  kernel.name = chosen.name;
  kernel.work = {.macs = static_cast<int64_t>(binding.outputs.size()) * p.macs(),
                 .uses_blas = chosen.uses_blas};
  kernel.scratch = floats(input_scratch + chosen.scratch_floats(p));
  kernel.run = [p, &chosen, input_scratch, &weights = binding.weights,
                offsets = fusion.channel_offsets](const Call& call) {
    for (size_t i = 0; i < call.outputs.size(); ++i) {
      const float* input =
          offsets ? write_channels(p, *offsets, call.inputs[i], call.scratch) : call.inputs[i];
      chosen.run(p, input, weights[0].values.data(), bias_of(weights), call.outputs[i],
                 call.scratch + input_scratch);
    }
  };
  return kernel;
}

}  // namespace revisit::engine
