#include "layers/planar_convolution.h"

#include <algorithm>
#include <stdexcept>

#include "held_epilogue.h"
#include "kernels/blocked/convolution_max_pool.h"
#include "kernels/epilogue_plain.h"
#include "layers/convolution_weights.h"

namespace revisit::engine {
namespace {

/// Whether lanes and weights are not mostly padding: a few channels on a large image, or a huge
/// kernel of one channel, would take many times the memory of the plain kernels.
bool pays(const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
  constexpr int64_t kMostWaste = 2, kMostExpansion = 16, kSmall = 4 << 20;
  const int64_t packed = kernel.packed_floats(p);
  return padded_channels(p.c_out) <= kMostWaste * p.c_out &&
         (packed <= kSmall || packed / kMostExpansion <= p.c_out * p.depth());
}

const BlockedConvolutionKernel* choose_for(const ConvolutionProblem& p, Layout input,
                                           const ConvolutionLimits& limits) {
  const BlockedConvolutionKernel* const kernel = choose_blocked_convolution(p, input, limits);
  return kernel && pays(*kernel, p) ? kernel : nullptr;
}

/// Runs a blocked kernel, alone or with normalisation and pooling behind it.
struct RunBlocked {
  ConvolutionProblem problem;
  const BlockedConvolutionKernel& chosen;
  std::optional<LrnProblem> lrn;
  std::optional<PoolingProblem> pooling;

  ConvolutionMaxPool with_pooling() const { return {problem, lrn ? &*lrn : nullptr, *pooling}; }
  std::string name() const {
    return str(chosen.name, lrn ? " + lrn" : "", pooling ? " + max-pool" : "");
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

WeightSource source_of(const Binding& binding) {
  if (binding.originals) return {binding.originals, binding.cache, binding.layer};
  return {[&weights = binding.weights] {
            const std::shared_ptr<const void> not_owned;
            return std::shared_ptr<const std::vector<Tensor>>(not_owned, &weights);
          },
          binding.cache, binding.layer};
}

Kernel bind_blocked(const BlockedConvolutionKernel& chosen, const FusedConvolution& convolution,
                    const Binding& binding) {
  const Fusion& fusion = convolution.fusion();
  const RunBlocked run{convolution.problem(), chosen, fusion.lrn, fusion.pooling};
  Kernel kernel;
  kernel.name = run.name();
  kernel.reads.assign(binding.inputs.size(), chosen.input);
  if (fusion.adds_last_input) kernel.reads.back() = Layout::kBlocked;
  kernel.writes = Layout::kBlocked;
  kernel.packed_floats = convolution.packed_floats(chosen);
  kernel.scratch_floats = run.scratch_floats();
  kernel.hold = [convolution, &chosen, source = source_of(binding)] {
    return convolution.packed(chosen, source);
  };
  kernel.run = [run, adds = fusion.adds_last_input,
                held = HeldEpilogue(fusion.activation)](const Call& call) {
    for (size_t i = 0; i < call.outputs.size(); ++i)
      run({call.inputs[i], call.weights->weights, call.weights->bias,
           adds ? call.inputs.back() : nullptr, held.epilogue, call.outputs[i], call.scratch,
           call.weights->outside});
  };
  return kernel;
}

const ConvolutionKernel& choose_plain(const ConvolutionProblem& p, bool reference) {
  const auto kernels = convolution_kernels();
  return reference
             ? kernels.back()
             : *std::find_if(kernels.begin(), kernels.end(),
                             [&](const ConvolutionKernel& kernel) { return kernel.supports(p); });
}

/// The picture and a channel of ones beside it.
const float* with_ones(const ConvolutionProblem& p, const float* picture, float* scratch) {
  const int64_t pixels = p.h * p.w;
  for (int64_t n = 0; n < p.n; ++n) {
    std::copy_n(picture + n * pixels, pixels, scratch + 2 * n * pixels);
    std::fill_n(scratch + (2 * n + 1) * pixels, pixels, 1.0F);
  }
  return scratch;
}

Kernel bind_plain(const FusedConvolution& convolution, const Binding& binding) {
  ConvolutionProblem p = convolution.problem();
  const Fusion& fusion = convolution.fusion();
  if (fusion.pooling) throw std::logic_error("a convolution on plain values cannot pool");
  const bool has_ones = convolution.has_constants();
  if (has_ones) p.c_in = 2;
  const ConvolutionKernel& chosen = choose_plain(p, binding.reference_kernels);
  // Of a gray input they are a copy already, with scale and shift in it.
  std::optional<HeldAffine> affine;
  if (fusion.affine && !fusion.gray_offsets) affine = HeldAffine(*fusion.affine);
  const int64_t input_scratch = has_ones ? p.n * p.c_in * p.h * p.w : 0;
  Kernel kernel;
  kernel.name = chosen.name;
  kernel.packed_floats = convolution.plain_floats();
  kernel.scratch_floats = input_scratch + chosen.scratch_floats(p);
  kernel.hold = [convolution, source = source_of(binding)] { return convolution.plain(source); };
  kernel.run = [p, &chosen, has_ones, input_scratch, affine, adds = fusion.adds_last_input,
                held = HeldEpilogue(fusion.activation)](const Call& call) {
    for (size_t i = 0; i < call.outputs.size(); ++i) {
      const float* input = has_ones ? with_ones(p, call.inputs[i], call.scratch) : call.inputs[i];
      chosen.run(p, input, call.weights->weights, call.weights->bias, call.outputs[i],
                 call.scratch + input_scratch);
      finish({p.n, p.c_out, p.out_pixels()},
             {affine ? affine->scale->data() : nullptr, affine ? affine->shift->data() : nullptr,
              adds ? call.inputs.back() : nullptr, held.epilogue},
             p.threads, call.outputs[i]);
    }
  };
  return kernel;
}

}  // namespace

const BlockedConvolutionKernel* choose_convolution(const ConvolutionProblem& problem,
                                                   const Fusion& fusion, Layout input,
                                                   const ConvolutionLimits& limits) {
  const FusedConvolution convolution(problem, fusion);
  const ConvolutionProblem& p = convolution.problem();
  const ConvolutionLimits of_kernel{limits.transform_points,
                                    convolution.most_packed_floats(limits.packed_floats)};
  // Both are made for the plain input, also where another layer has it in blocks.
  if (fusion.gray_offsets || fusion.pooling) return choose_for(p, Layout::kPlain, of_kernel);
  if (input == Layout::kPlain)
    if (const auto* kernel = choose_for(p, Layout::kPlain, of_kernel)) return kernel;
  return choose_for(p, Layout::kBlocked, of_kernel);
}

int64_t packed_floats(const ConvolutionProblem& problem, const Fusion& fusion,
                      const BlockedConvolutionKernel& kernel) {
  return FusedConvolution(problem, fusion).packed_floats(kernel);
}

Kernel bind_planar_convolution(const ConvolutionProblem& problem, const Binding& binding) {
  const FusedConvolution convolution(problem, binding.fusion);
  return binding.convolution ? bind_blocked(*binding.convolution, convolution, binding)
                             : bind_plain(convolution, binding);
}

}  // namespace revisit::engine
