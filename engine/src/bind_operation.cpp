#include "bind_operation.h"

#include <algorithm>

#include "held_post_ops.h"
#include "kernels/blocked/gate.h"

namespace revisit::engine {
namespace {

BlockedSize size_of(const Binding& binding) {
  const Shape& shape = binding.outputs[0];
  return {shape[0], shape[1], shape.product(2, shape.rank()), binding.threads, binding.precision};
}

Kernel bind_activation(const Activating& activation, const Binding& binding) {
  return blocked_kernel("activation", 1, [size = size_of(binding), activation](const Call& call) {
    blocked_activation(size, activation.epilogue, call.inputs[0], call.outputs[0]);
  });
}

Kernel bind_affine(const ChannelAffine& affine, const Binding& binding) {
  const std::optional<ChannelAffine>& next = binding.fusion.affine;
  return blocked_kernel(
      "scale", 1,
      [size = size_of(binding), factors = HeldAffine(next ? composed(affine, *next) : affine),
       activation = binding.fusion.activation](const Call& call) {
        blocked_scale(size, factors.scale->data(), factors.shift->data(), activation.epilogue,
                      call.inputs[0], call.outputs[0]);
      });
}

const char* name_of(BlockedEltwise::Operation operation) {
  switch (operation) {
    case BlockedEltwise::Operation::kProduct:
      return "product";
    case BlockedEltwise::Operation::kMaximum:
      return "maximum";
    case BlockedEltwise::Operation::kSum:
      break;
  }
  return "sum";
}

Kernel bind_combination(const Combining& combining, const Binding& binding) {
  return blocked_kernel(
      name_of(combining.operation), binding.inputs.size(),
      [size = size_of(binding), combining,
       activation = binding.fusion.activation](const Call& call) {
        blocked_eltwise(size, {combining.operation, combining.coefficients, activation.epilogue},
                        call.inputs, call.outputs[0]);
      });
}

/// The factors are few: they are read as plain values, which need no padding.
Kernel bind_gate(const Gating& gating, const Binding& binding) {
  std::optional<size_t> addend = gating.addend;
  if (binding.fusion.adds_last_input) addend = binding.inputs.size() - 1;
  Kernel kernel = blocked_kernel(
      addend ? "gate + sum" : "gate", binding.inputs.size(),
      [size = size_of(binding), gating, addend,
       activation = binding.fusion.activation](const Call& call) {
        blocked_gate(size,
                     {call.inputs[gating.factors], addend ? call.inputs[*addend] : nullptr,
                      gating.zero_hides, activation.epilogue},
                     call.inputs[gating.x], call.outputs[0]);
      });
  kernel.reads[gating.factors] = Layout::kNchw;
  return kernel;
}

/// Whether more than the factors is there in blocks.
bool gates_blocks(const Gating& gating, const Binding& binding) {
  for (size_t i = 0; i < binding.inputs.size(); ++i)
    if (i != gating.factors && binding.blocked(i)) return true;
  return false;
}

/// A kernel on plain values with what is fused to it done afterwards, in place.
Kernel finished(Kernel kernel, const Binding& binding) {
  const Fusion& fusion = binding.fusion;
  if (!fusion.affine && !fusion.adds_last_input &&
      fusion.activation.epilogue.activation == Epilogue::Activation::kNone)
    return kernel;
  kernel.run = [run = std::move(kernel.run), post_ops = HeldPostOps(binding)](const Call& call) {
    run(call);
    post_ops(call.inputs.back(), call.outputs[0]);
  };
  return kernel;
}

}  // namespace

Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding) {
  if (std::holds_alternative<Convolving>(form)) return layer.bind(binding);
  const bool any_blocked =
      std::count(binding.layouts.begin(), binding.layouts.end(), Layout::kNChw16c) > 0;
  if (any_blocked) {
    if (const auto* activation = std::get_if<Activating>(&form))
      return bind_activation(*activation, binding);
    if (const auto* affine = std::get_if<ChannelAffine>(&form))
      return bind_affine(*affine, binding);
    if (const auto* combining = std::get_if<Combining>(&form))
      return bind_combination(*combining, binding);
    const auto* gating = std::get_if<Gating>(&form);
    if (gating && gates_blocks(*gating, binding)) return bind_gate(*gating, binding);
  }
  return finished(layer.bind(binding), binding);
}

}  // namespace revisit::engine
