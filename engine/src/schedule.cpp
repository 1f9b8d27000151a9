#include "schedule.h"

#include <algorithm>

#include "kernels/blocked/kernels.h"
#include "kernels/channels.h"
#include "kernels/epilogue.h"
#include "layers/convolution.h"
#include "layers/layers.h"
#include "plan_impl.h"
#include "revisit/base/hash.h"

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
  const AxisRuns runs =
      shape.rank() < 2 ? AxisRuns{.inner = shape.elements()} : runs_along(shape, 1);
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

/// Fills rows (axis 0) that `kernel` does not write with zeros, because readers use them.
Kernel with_zero_rest(Kernel kernel, const std::vector<Shape>& outputs) {
  kernel.run = [run = std::move(kernel.run), outputs](const Call& call) {
    run(call);
    for (size_t i = 0; i < outputs.size(); ++i)
      std::fill(call.outputs[i] + *call.rows * outputs[i].product(1, outputs[i].rank()),
                call.outputs[i] + outputs[i].elements(), 0.0F);
  };
  return kernel;
}

Kernel reorder_kernel(const Shape& shape, Layout to, const PlanOptions& options) {
  const BlockedSize size{shape[0], shape[1], shape.product(2, shape.rank()), options.threads,
                         options.precision};
  return {"reorder", [size, to](const Call& call) {
            if (to == Layout::kNChw16c)
              reorder_to_nchwc(size, call.inputs[0], call.outputs[0]);
            else
              reorder_to_nchw(size, call.inputs[0], call.outputs[0]);
          }};
}

class Scheduler {
 public:
  Scheduler(const Net::Impl& net, const std::vector<Shape>& shapes, const Operations& operations,
            const PlanOptions& options, bool may_pack)
      : net_(net),
        shapes_(shapes),
        operations_(operations),
        options_(options),
        may_pack_(may_pack) {
    result_.nchw.resize(shapes.size());
    blocked_.resize(shapes.size());
  }

  Schedule run() {
    for (size_t i = 0; i < net_.graph.nodes.size(); ++i)
      if (!net_.graph.nodes[i].layer)
        for (const ValueId id : net_.graph.nodes[i].outputs) {
          result_.inputs.push_back(pin(store(id, Layout::kNchw)));
          if (net_.blocked_inputs.contains(id) && shapes_[id].rank() == 4 && may_pack_ &&
              !options_.reference_kernels)
            require(id, Layout::kNChw16c, i);
        }
    for (const Operation& operation : operations_.list)
      at_layer(net_.file, net_.graph.nodes[operation.node], [&] { add(operation); });
    return std::move(result_);
  }

 private:
  std::optional<size_t>& place(ValueId id, Layout layout) {
    return layout == Layout::kNChw16c ? blocked_[id] : result_.nchw[id];
  }

  size_t store(ValueId id, Layout layout) {
    const Shape shape = operations_.gray_input == id ? shapes_[id].with(1, 1) : shapes_[id];
    const int64_t bytes = layout == Layout::kNchw
                              ? floats(shape.elements()).count
                              : shape.elements() / shape[1] * padded_channels(shape[1]) *
                                    value_bytes(options_.precision);
    result_.stored.push_back({id, layout, shape, bytes});
    place(id, layout) = result_.stored.size() - 1;
    return result_.stored.size() - 1;
  }

  size_t pin(size_t stored) {
    result_.stored[stored].pinned = true;
    return stored;
  }

  /// Returns the stored value in this layout; adds a reorder, attributed to `layer`, if needed.
  size_t require(ValueId id, Layout layout, size_t layer) {
    if (const auto found = place(id, layout)) return *found;
    const Layout other = layout == Layout::kNchw ? Layout::kNChw16c : Layout::kNchw;
    const size_t from = place(id, other).value();
    const size_t to = store(id, layout);
    result_.steps.push_back({layer,
                             reorder_kernel(result_.stored[from].shape, layout, options_),
                             OutputMemory::kOwn,
                             {from},
                             {to},
                             true});
    return to;
  }

  void add(const Operation& operation) {
    const std::vector<Shape> inputs = shapes_of(operation.inputs, shapes_);
    const std::vector<Shape> outputs = shapes_of(operation.outputs, shapes_);
    Step step{operation.node, {}, operation.layer.get().output_memory(), {}, {}};
    if (step.memory != OutputMemory::kViewOfInput) {
      check_outputs(outputs, options_.max_run_bytes);
      const BlockedConvolutionKernel* const convolution = convolution_kernel(operation);
      step.kernel = bind(operation, convolution, inputs, outputs);
      if (operation.layer.get().dynamic_axis() == 0U)
        step.kernel = with_zero_rest(std::move(step.kernel), outputs);
      step.selection_reason = why(operation, convolution);
      result_.packed_bytes += step.kernel.packed.count;
    }
    for (size_t i = 0; i < operation.inputs.size(); ++i)
      step.inputs.push_back(require(
          operation.inputs[i], step.kernel.reads.empty() ? Layout::kNchw : step.kernel.reads[i],
          operation.node));
    for (const ValueId id : operation.outputs)
      step.outputs.push_back(store(id, step.kernel.writes));
    result_.steps.push_back(std::move(step));
    for (const ValueId id : operation.outputs)
      if (operations_.read_outside[id]) pin(require(id, Layout::kNchw, operation.node));
  }

  Kernel bind(const Operation& operation, const BlockedConvolutionKernel* convolution,
              const std::vector<Shape>& inputs, const std::vector<Shape>& outputs) {
    Binding binding{inputs, outputs, *net_.graph.nodes[operation.node].weights, options_.threads,
                    options_.reference_kernels};
    if (!options_.reference_kernels)
      for (const ValueId id : operation.inputs)
        binding.layouts.push_back(blocked_[id] ? Layout::kNChw16c : Layout::kNchw);
    binding.fusion = operation.fusion;
    if (!options_.reference_kernels) binding.precision = options_.precision;
    // The key is the layer's index in the file, because several layers can have one name.
    binding.seed =
        options_.seed + mixed_bits(static_cast<uint64_t>(net_.graph.nodes[operation.node].index));
    binding.bf16_weights = may_pack_ && !options_.reference_kernels &&
                           (options_.bf16_weights || options_.precision == Precision::kBf16);
    binding.cache = &net_.packed_weights;
    binding.layer = operation.node;
    binding.convolution = convolution;
    return bind_operation(operation.layer, operation.form, binding);
  }

  /// Kernel of a convolution; null if it is not a convolution or uses an NCHW kernel.
  const BlockedConvolutionKernel* convolution_kernel(const Operation& operation) const {
    const auto* convolving = std::get_if<Convolving>(&operation.form);
    if (!convolving || options_.reference_kernels || !may_pack_) return nullptr;
    if (operation.convolution) return operation.convolution;
    return choose(operation, convolving->problem, operation.max_winograd_points);
  }

  const BlockedConvolutionKernel* choose(const Operation& operation,
                                         const ConvolutionProblem& problem, int most_points) const {
    const Layout input = blocked_[operation.inputs[0]] ? Layout::kNChw16c : Layout::kNchw;
    return choose_convolution(problem, operation.fusion, input, most_points);
  }

  /// LayerCost::selection_reason.
  const char* why(const Operation& operation, const BlockedConvolutionKernel* chosen) const {
    const auto* convolving = std::get_if<Convolving>(&operation.form);
    if (!convolving) return "";
    if (options_.reference_kernels) return "reference requested";
    const ConvolutionProblem& problem = convolving->problem;
    if (!may_pack_ && choose(operation, problem, operation.max_winograd_points))
      return "memory limit";
    if (!operation.convolution && choose(operation, problem, kAnyPoints) != chosen)
      return options_.strict_accuracy ? "strict accuracy" : "rounding amplified later";
    return chosen ? "fastest predicted" : "blocking not faster";
  }

  const Net::Impl& net_;
  const std::vector<Shape>& shapes_;
  const Operations& operations_;
  const PlanOptions& options_;
  Schedule result_;
  bool may_pack_;
  std::vector<std::optional<size_t>> blocked_;  // per value, like Schedule::nchw
};

}  // namespace

Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding) {
  if (binding.convolution)
    return bind_blocked_convolution(std::get<Convolving>(form).problem, binding);
  if (std::optional<Kernel> kernel = bind_blocked(form, binding)) return *std::move(kernel);
  return with_fused_operations(layer.bind(binding), binding);
}

Schedule schedule(const Net::Impl& net, const std::vector<Shape>& shapes,
                  const Operations& operations, const PlanOptions& options, bool may_pack) {
  return Scheduler(net, shapes, operations, options, may_pack).run();
}

}  // namespace revisit::engine
