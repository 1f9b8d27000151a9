#include "layers/planar_convolution.h"

#include <algorithm>

#include "fold.h"
#include "kernels/blocked/convolution.h"
#include "kernels/epilogue_plain.h"
#include "weight_cache.h"

namespace revisit::engine {
namespace {

/// A convolution with all that its kernel needs to know of the fusion around it.
struct Planned {
  ConvolutionProblem problem;  // on the channels that the input has in memory
  int64_t gray_channels = 0;   // 0: the input has its own channels
  WeightSize weight_size;      // of the file
  const float* weights;
  const float* bias;
  const Fusion& fusion;

  Planned(const ConvolutionProblem& p, const Binding& binding, const float* file_weights,
          const float* file_bias)
      : problem(p),
        gray_channels(engine::gray_channels(binding.fusion, p.pad_h > 0 || p.pad_w > 0)),
        weight_size{p.c_out, p.c_in_per_group(), p.kernel_h * p.kernel_w},
        weights(file_weights),
        bias(file_bias),
        fusion(binding.fusion) {
    if (gray_channels > 0) problem.c_in = gray_channels;
  }

  bool changes_weights() const { return gray_channels > 0 || fusion.affine; }
  FoldedWeights folded() const { return fold(fusion, weight_size, gray_channels, weights, bias); }
  /// Floats of scratch that the input needs before the kernel's own.
  int64_t input_scratch() const {
    return gray_channels == 2 ? problem.n * 2 * problem.h * problem.w : 0;
  }
};

AlignedFloats padded(std::span<const float> values, int64_t size) {
  AlignedFloats result(size);
  std::fill(std::copy(values.begin(), values.end(), result.data()), result.data() + size, 0.0F);
  return result;
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

Epilogue epilogue_of(const Fusion& fusion, const PackedWeights* packed) {
  Epilogue epilogue = fusion.activation.epilogue;
  if (packed && packed->slopes.size() > 0) epilogue.slopes = packed->slopes.data();
  return epilogue;
}

/// Whether lanes and weights are not mostly padding: a few channels on a large image, or a huge
/// kernel of one channel, would take many times the memory of the plain kernels.
bool pays(const BlockedConvolutionKernel& kernel, const ConvolutionProblem& p) {
  constexpr int64_t kMostWaste = 2, kMostExpansion = 16, kSmall = 4 << 20;
  const int64_t packed = kernel.packed_floats(p);
  return padded_channels(p.c_out) <= kMostWaste * p.c_out &&
         (packed <= kSmall || packed / kMostExpansion <= p.c_out * p.depth());
}

const BlockedConvolutionKernel* choose(const Planned& plan, const Binding& binding) {
  if (binding.reference_kernels || binding.layouts.empty()) return nullptr;
  // Of ResNet-50 (golden/slim), the error against the original is 3e-5 with any kernels whose
  // transforms have up to 7 points, 1.5e-4 with 8 and 2.7e-4 with 9.
  constexpr int kCarefulPoints = 6;
  const int most_points = binding.careful ? kCarefulPoints : kAnyPoints;
  const BlockedConvolutionKernel* kernel = nullptr;
  if (plan.gray_channels > 0 || binding.layouts[0] == Layout::kPlain)
    kernel = choose_blocked_convolution(plan.problem, Layout::kPlain, most_points);
  if (!kernel && plan.gray_channels == 0)
    kernel = choose_blocked_convolution(plan.problem, Layout::kBlocked, most_points);
  return kernel && pays(*kernel, plan.problem) ? kernel : nullptr;
}

Kernel bind_blocked(const BlockedConvolutionKernel& chosen, const Planned& plan,
                    const Binding& binding) {
  const ConvolutionProblem& p = plan.problem;
  const int64_t lanes = padded_channels(p.c_out);
  const std::vector<float>& slopes = plan.fusion.activation.slopes;
  const auto pack = [&] {
    const FoldedWeights folded = plan.folded();
    PackedWeights packed{AlignedFloats(chosen.packed_floats(p)), padded(folded.bias, lanes),
                         slopes.empty() ? AlignedFloats() : padded(slopes, lanes)};
    chosen.pack(p, folded.weights.data(), packed.weights.data());
    return packed;
  };
  std::shared_ptr<const PackedWeights> packed;  // null when the net is only inspected
  if (plan.weights) packed = binding.cache->get(binding.cache_key + "\n" + chosen.name, pack);

  Kernel kernel;
  kernel.name = chosen.name;
  kernel.reads.assign(binding.inputs.size(), chosen.input);
  if (plan.fusion.adds_last_input) kernel.reads.back() = Layout::kBlocked;
  kernel.writes = Layout::kBlocked;
  kernel.packed_floats = chosen.packed_floats(p) + lanes + (slopes.empty() ? 0 : lanes);
  const int64_t input_scratch = plan.input_scratch();
  kernel.scratch_floats = input_scratch + chosen.scratch_floats(p);
  kernel.run = [p, &chosen, packed, epilogue = epilogue_of(plan.fusion, packed.get()),
                adds = plan.fusion.adds_last_input, input_scratch](const Call& call) {
    for (size_t i = 0; i < call.outputs.size(); ++i)
      chosen.run(p,
                 {input_scratch > 0 ? with_ones(p, call.inputs[i], call.scratch) : call.inputs[i],
                  packed->weights.data(), packed->bias.data(), adds ? call.inputs.back() : nullptr,
                  epilogue, call.outputs[i], call.scratch + input_scratch});
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

Kernel bind_plain(const Planned& plan, const Binding& binding) {
  const ConvolutionProblem& p = plan.problem;
  const ConvolutionKernel& chosen = choose_plain(p, binding.reference_kernels);
  const std::vector<float>& slopes = plan.fusion.activation.slopes;
  const auto pack = [&] {
    FoldedWeights folded;
    if (plan.changes_weights()) folded = plan.folded();
    return PackedWeights{padded(folded.weights, static_cast<int64_t>(folded.weights.size())),
                         padded(folded.bias, static_cast<int64_t>(folded.bias.size())),
                         padded(slopes, static_cast<int64_t>(slopes.size()))};
  };
  Kernel kernel;
  kernel.name = chosen.name;
  std::shared_ptr<const PackedWeights> packed;
  const float *weights = plan.weights, *bias = plan.bias;
  if (plan.changes_weights()) {
    kernel.packed_floats = p.c_out * (p.depth() + 1);
    if (weights) {
      packed = binding.cache->get(binding.cache_key + "\nplain", pack);
      weights = packed->weights.data(), bias = packed->bias.data();
    }
  } else if (weights && !slopes.empty()) {
    packed = binding.cache->get(binding.cache_key + "\nplain", pack);
  }
  kernel.packed_floats += static_cast<int64_t>(slopes.size());
  const int64_t input_scratch = plan.input_scratch();
  kernel.scratch_floats = input_scratch + chosen.scratch_floats(p);
  kernel.run = [p, &chosen, packed, weights, bias, input_scratch,
                epilogue = epilogue_of(plan.fusion, packed.get()),
                adds = plan.fusion.adds_last_input](const Call& call) {
    for (size_t i = 0; i < call.outputs.size(); ++i) {
      chosen.run(p, input_scratch > 0 ? with_ones(p, call.inputs[i], call.scratch) : call.inputs[i],
                 weights, bias, call.outputs[i], call.scratch + input_scratch);
      add_and_activate({p.n, p.c_out, p.out_pixels()}, epilogue,
                       adds ? call.inputs.back() : nullptr, p.threads, call.outputs[i]);
    }
  };
  return kernel;
}

}  // namespace

Kernel bind_planar_convolution(const ConvolutionProblem& problem, const Binding& binding,
                               const float* weights, const float* bias) {
  const Planned plan(problem, binding, weights, bias);
  if (const BlockedConvolutionKernel* chosen = choose(plan, binding))
    return bind_blocked(*chosen, plan, binding);
  return bind_plain(plan, binding);
}

}  // namespace revisit::engine
