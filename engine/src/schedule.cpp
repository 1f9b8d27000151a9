#include "schedule.h"

#include "kernels/blocked/kernels.h"
#include "layers/convolution.h"
#include "plan_impl.h"
#include "revisit/base/hash.h"

namespace revisit::engine {
namespace {

Kernel reorder_kernel(const Shape& shape, Layout to, const PlanOptions& options) {
  const BlockedSize size{shape[0], shape[1], shape.product(2, shape.rank()), options.threads,
                         options.precision};
  Kernel kernel;
  kernel.name = "reorder";
  kernel.run = [size, to](const Call& call) {
    if (to == Layout::kNChw16c)
      reorder_to_nchwc(size, call.inputs[0], call.outputs[0]);
    else
      reorder_to_nchw(size, call.inputs[0], call.outputs[0]);
  };
  return kernel;
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
    for (const Operation& operation : operations_.list) {
      try {
        add(operation);
      } catch (const Error&) {
        rethrow_at(net_.file, net_.graph.nodes[operation.node]);
      }
    }
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

Schedule schedule(const Net::Impl& net, const std::vector<Shape>& shapes,
                  const Operations& operations, const PlanOptions& options, bool may_pack) {
  return Scheduler(net, shapes, operations, options, may_pack).run();
}

}  // namespace revisit::engine
