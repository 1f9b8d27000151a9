#include <algorithm>

#include "kernels/blocked/kernels.h"
#include "kernels/channels.h"
#include "kernels/epilogue.h"
#include "layers/convolution.h"
#include "layers/join_and_cut.h"
#include "schedule.h"

namespace revisit::engine {
namespace {

BlockedSize size_of(const Binding& binding) {
  const Shape& shape = binding.outputs[0];
  return {shape[0], shape[1], shape.product(2, shape.rank()), binding.threads, binding.precision};
}

Kernel bind_activation(const Activating& activation, const Binding& binding) {
  return {"activation", [size = size_of(binding), activation](const Call& call) {
            blocked_activation(size, activation.epilogue, call.inputs[0], call.outputs[0]);
          }};
}

Kernel bind_affine(const ChannelAffine& affine, const Binding& binding) {
  const auto padded_to_blocks = [](const std::vector<double>& values) {
    const int64_t lanes = padded_channels(static_cast<int64_t>(values.size()));
    return std::make_shared<const AlignedFloats>(padded(values, lanes));
  };
  const std::optional<ChannelAffine>& next = binding.fusion.affine;
  const ChannelAffine all = next ? composed(affine, *next) : affine;
  return {"scale", [size = size_of(binding), scale = padded_to_blocks(all.scale),
                    shift = padded_to_blocks(all.shift),
                    activation = binding.fusion.activation](const Call& call) {
            blocked_scale(size, scale->data(), shift->data(), activation.epilogue, call.inputs[0],
                          call.outputs[0]);
          }};
}

Kernel bind_combination(const Combining& combining, const Binding& binding) {
  static constexpr const char* kNames[] = {"sum", "product", "maximum"};
  return {kNames[static_cast<size_t>(combining.operation)],
          [size = size_of(binding), combining,
           activation = binding.fusion.activation](const Call& call) {
            blocked_eltwise(size,
                            {combining.operation, combining.coefficients, activation.epilogue},
                            call.inputs, call.outputs[0]);
          }};
}

Kernel bind_gate(const Gating& gating, const Binding& binding) {
  std::optional<size_t> addend = gating.addend;
  if (binding.fusion.adds_last_input) addend = binding.inputs.size() - 1;
  return {addend ? "gate + sum" : "gate",
          [size = size_of(binding), gating, addend,
           activation = binding.fusion.activation](const Call& call) {
            blocked_gate(size,
                         {call.inputs[gating.factors], addend ? call.inputs[*addend] : nullptr,
                          gating.zero_hides, activation.epilogue},
                         call.inputs[gating.x], call.outputs[0]);
          }};
}

Kernel bind_lrn(LrnProblem lrn, const Binding& binding) {
  lrn.threads = binding.threads;
  lrn.values = binding.precision;
  if (!binding.fusion.pooling)
    return {"lrn-across",
            [lrn](const Call& call) {
              blocked_lrn(lrn, call.inputs[0], call.outputs[0], call.scratch);
            },
            floats(blocked_lrn_scratch_floats(lrn))};
  PoolingProblem pooling = *binding.fusion.pooling;
  pooling.threads = lrn.threads;
  pooling.values = lrn.values;
  return {"lrn + max-pool",
          [lrn, pooling](const Call& call) {
            blocked_lrn_max_pool(lrn, pooling, call.inputs[0], call.outputs[0], call.scratch);
          },
          floats(blocked_lrn_max_pool_scratch_floats(lrn, pooling))};
}

Kernel bind_pooling(const char* name, decltype(blocked_max_pool)* pool, PoolingProblem problem,
                    const Binding& binding) {
  problem.threads = binding.threads;
  problem.values = binding.precision;
  return {name, [problem, channels = binding.inputs[0][1], pool](const Call& call) {
            pool(problem, channels, call.inputs[0], call.outputs[0]);
          }};
}

Kernel bind_shuffle(const Shuffling& shuffling, const Binding& binding) {
  return {"transpose", [size = size_of(binding), sources = shuffling.sources](const Call& call) {
            blocked_shuffle(size, sources, call.inputs[0], call.outputs[0]);
          }};
}

bool are_whole_blocks(const std::vector<Shape>& parts) {
  return std::all_of(parts.begin(), parts.end() - 1,
                     [](const Shape& part) { return part[1] % kLanes == 0; });
}

std::vector<int64_t> image_sizes(const std::vector<Shape>& parts, Precision values) {
  std::vector<int64_t> sizes;
  for (const Shape& part : parts)
    sizes.push_back(padded_channels(part[1]) * part[2] * part[3] * value_bytes(values) /
                    floats(1).count);
  return sizes;
}

std::optional<Kernel> blocked_kernel(const Form& form, const Binding& binding) {
  if (const auto* activation = std::get_if<Activating>(&form))
    return bind_activation(*activation, binding);
  if (const auto* affine = std::get_if<ChannelAffine>(&form)) return bind_affine(*affine, binding);
  if (const auto* combining = std::get_if<Combining>(&form))
    return bind_combination(*combining, binding);
  if (const auto* gating = std::get_if<Gating>(&form)) return bind_gate(*gating, binding);
  if (const auto* lrn = std::get_if<LrnProblem>(&form)) return bind_lrn(*lrn, binding);
  const auto* maximum = std::get_if<PoolingProblem>(&form);
  if (maximum && binding.outputs.size() == 1)  // there is no mask in blocked layout
    return bind_pooling("max-pool", blocked_max_pool, *maximum, binding);
  if (const auto* mean = std::get_if<Averaging>(&form))
    return bind_pooling("average-pool", blocked_average_pool, mean->problem, binding);
  if (const auto* shuffling = std::get_if<Shuffling>(&form))
    return bind_shuffle(*shuffling, binding);
  if (std::holds_alternative<Joining>(form) && are_whole_blocks(binding.inputs))
    return join_kernel(binding.inputs[0][0], image_sizes(binding.inputs, binding.precision));
  if (std::holds_alternative<Cutting>(form) && are_whole_blocks(binding.outputs))
    return cut_kernel(binding.inputs[0][0], image_sizes(binding.outputs, binding.precision),
                      binding.threads);
  return std::nullopt;
}

/// Factors of a gate are few, so kernels read them in NCHW without padding.
std::optional<Kernel> bind_blocked(const Form& form, const Binding& binding) {
  const auto* const gating = std::get_if<Gating>(&form);
  bool any_blocked = binding.fusion.pooling.has_value();  // only NCHWc kernels fuse pooling
  for (size_t i = 0; i < binding.layouts.size(); ++i)
    any_blocked |= binding.layouts[i] == Layout::kNChw16c && !(gating && i == gating->factors);
  if (!any_blocked) return std::nullopt;
  std::optional<Kernel> kernel = blocked_kernel(form, binding);
  if (!kernel) return std::nullopt;
  kernel->reads.assign(binding.inputs.size(), Layout::kNChw16c);
  if (gating) kernel->reads[gating->factors] = Layout::kNchw;
  kernel->writes = Layout::kNChw16c;
  return kernel;
}

Epilogue of_channel(const Epilogue& e, int64_t channel) {
  if (e.activation != Epilogue::Activation::kPrelu) return e;
  return {.activation = Epilogue::Activation::kRelu, .slope = e.slopes[channel]};
}

Kernel with_fused_operations(Kernel kernel, const Binding& binding) {
  const Fusion& fusion = binding.fusion;
  if (!fusion.affine && !fusion.adds_last_input &&
      fusion.activation.epilogue.activation == Epilogue::Activation::kNone)
    return kernel;
  const Shape& shape = binding.outputs[0];
  const ChannelRuns runs = shape.rank() < 2
                               ? ChannelRuns{1, 1, shape.elements()}
                               : ChannelRuns{shape[0], shape[1], shape.product(2, shape.rank())};
  std::vector<ChannelNorm> norms;
  for (size_t c = 0; fusion.affine && c < fusion.affine->scale.size(); ++c)
    norms.push_back({.factor = static_cast<float>(fusion.affine->scale[c]),
                     .shift = static_cast<float>(fusion.affine->shift[c])});
  kernel.run = [run = std::move(kernel.run), runs, threads = binding.threads,
                norms = std::move(norms), adds = fusion.adds_last_input,
                activation = fusion.activation](const Call& call) {
    run(call);
    float* const values = call.outputs[0];
    const float* const addend = adds ? call.inputs.back() : nullptr;
    for_each_run(runs, threads, [&](int64_t channel, int64_t begin, int64_t end) {
      if (!norms.empty()) normalize(norms[channel], values + begin, end - begin, values + begin);
      if (addend)
        for (int64_t i = begin; i < end; ++i) values[i] += addend[i];
      activate(of_channel(activation.epilogue, channel), end - begin, values + begin,
               values + begin);
    });
  };
  return kernel;
}

}  // namespace

Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding) {
  if (binding.convolution)
    return bind_blocked_convolution(std::get<Convolving>(form).problem, binding);
  if (std::optional<Kernel> kernel = bind_blocked(form, binding)) return *std::move(kernel);
  return with_fused_operations(layer.bind(binding), binding);
}

}  // namespace revisit::engine
