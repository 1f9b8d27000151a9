#include <algorithm>
#include <stdexcept>

#include "kernels/blocked/kernels.h"
#include "layers/convolution.h"

namespace revisit::engine {
namespace {

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
                 .products = run.products(),
                 .winograd = chosen.transform_points > 0};
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
    for (size_t i = 0; i < call.outputs.size(); ++i)
      run({call.inputs[i], call.weights->weights, call.weights->bias,
           adds ? call.inputs.back() : nullptr, activation.epilogue, call.outputs[i], call.scratch,
           call.weights->outside_taps});
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
