#include <algorithm>
#include <limits>
#include <new>

#include "budget.h"
#include "buffers.h"
#include "fuse.h"
#include "plan_impl.h"
#include "trace.h"

namespace revisit::engine {
namespace {

constexpr auto kFloatBytes = static_cast<int64_t>(sizeof(float));
constexpr int64_t kMegabyte = 1 << 20;

std::vector<Shape> shapes_for(const Net::Impl& net, const std::map<std::string, Shape>& inputs) {
  std::map<std::string, Shape> input_shapes;
  for (const Port& port : net.inputs) input_shapes[port.name] = port.shape;
  for (const auto& [blob, shape] : inputs) input_shapes.insert_or_assign(blob, shape);
  return infer_shapes(net, input_shapes);
}

/// Weights belong to the shapes the net was loaded with; a reshape must not change what they are.
void check_weight_shapes(const Net::Impl& net, const std::vector<Shape>& shapes) {
  for (size_t n = 0; n < net.nodes.size(); ++n) {
    const LoadedNode& loaded = net.nodes[n];
    if (!loaded.layer) continue;
    std::vector<Shape> inputs;
    for (const ValueId id : net.graph.nodes[n].inputs) inputs.push_back(shapes[id]);
    try {
      const std::vector<Shape> wanted = loaded.layer->weight_shapes(inputs);
      for (size_t i = 0; i < wanted.size(); ++i)
        if (wanted[i] != loaded.weights[i].shape)
          throw InputError(str("with these input shapes weight blob ", i, " would have to be ",
                               wanted[i], ", it is ", loaded.weights[i].shape,
                               "; choose another input shape or cut the net before this layer"));
    } catch (const Error&) {
      rethrow_at(net.file, net.graph.nodes[n]);
    }
  }
}

Operations rewrite(const Net::Impl& net, const std::vector<Shape>& shapes,
                   const PlanOptions& options, int64_t most_packed_floats) {
  // Kept values are read from outside: nothing may be merged across them.
  const bool merge = !options.keep_all && !options.reference_kernels;
  Operations operations = operations_of(net, shapes);
  if (options.gray_offsets) fold_gray_input(net, shapes, *options.gray_offsets, &operations);
  limit_rounding(options.accuracy, &operations);
  return merge ? fuse(net, shapes, std::move(operations), most_packed_floats) : operations;
}

/// A plan that has taken no memory yet.
struct Draft {
  Operations operations;
  Schedule schedule;
  Placement placement;

  int64_t floats() const { return placement.arena_floats + schedule.packed_floats; }
};

Draft make_draft(const Net::Impl& net, const std::vector<Shape>& shapes, const PlanOptions& options,
                 int64_t most_packed_floats) {
  Draft draft;
  draft.operations = rewrite(net, shapes, options, most_packed_floats);
  draft.schedule = schedule(net, shapes, draft.operations, options, most_packed_floats);
  draft.placement = place(net, draft.schedule);
  return draft;
}

/// The fastest kernels whose packed weights and arena together keep to PlanOptions::max_run_bytes,
/// or what takes least when there are none. They are those of one thread, whose scratch is the
/// smallest: what a plan computes does not depend on its threads.
Draft make_draft_within_limit(const Net::Impl& net, const std::vector<Shape>& shapes,
                              const PlanOptions& options) {
  constexpr int kMostAttempts = 8;
  const int64_t limit = options.max_run_bytes / kFloatBytes;
  PlanOptions one_thread = options;
  one_thread.threads = 1;
  int64_t most_packed = std::numeric_limits<int64_t>::max() / 2;  // first as if without a limit
  for (int attempt = 1;; ++attempt) {
    Draft draft = make_draft(net, shapes, one_thread, most_packed);
    if (draft.floats() <= limit || most_packed == 0)
      return options.threads == 1 ? draft : make_draft(net, shapes, options, most_packed);
    // Less than it packs now. Other kernels may need more scratch: then once more.
    most_packed =
        attempt < kMostAttempts ? std::max(limit - draft.placement.arena_floats, int64_t{0}) : 0;
  }
}

int64_t count_elements(const std::vector<Tensor>& weights) {
  int64_t elements = 0;
  for (const Tensor& weight : weights) elements += weight.shape.elements();
  return elements;
}

/// What each layer is, as the file has it; costs are still to be counted.
std::vector<LayerCost> describe_layers(const Net::Impl& net, const std::vector<Shape>& shapes) {
  const Graph& graph = net.graph;
  Tracer tracer(graph);
  std::vector<LayerCost> costs;
  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    const Node& node = graph.nodes[i];
    LayerCost cost;
    cost.name = node.name;
    cost.type = node.param.type();
    for (const ValueId id : node.inputs) cost.inputs.push_back(shapes[id]);
    for (const ValueId id : node.outputs) {
      cost.outputs.push_back(shapes[id]);
      cost.blobs.push_back(graph.values[id].blob);
    }
    tracer.trace(i, net.nodes[i].layer.get(), &cost);
    cost.parameters = count_elements(net.nodes[i].weights);
    costs.push_back(std::move(cost));
  }
  return costs;
}

/// Every layer that another does the work of says which.
void name_absorbed(const Operations& operations, std::vector<LayerCost>* costs) {
  for (const Operation& operation : operations.list)
    for (const size_t layer : operation.absorbed)
      (*costs)[layer].kernel = "in " + (*costs)[operation.node].name;
}

void count_step(const ScheduledStep& step, bool runs, int64_t new_floats, LayerCost* cost) {
  cost->activation_bytes += new_floats * kFloatBytes;
  cost->packed_weight_bytes += step.kernel.packed_floats * kFloatBytes;
  cost->macs += step.kernel.macs;
  const std::string name = step.kernel.joins_inputs && !runs ? "in place" : step.kernel.name;
  // A reorder only shows where its layer runs nothing else; a view runs nothing.
  if (cost->kernel.empty() || (!step.is_reorder && !name.empty())) cost->kernel = name;
  if (!step.is_reorder) cost->why = step.why;
}

/// The weights of a step. Those of the file are released when it has a copy.
HeldWeights hold(const Net::Impl& net, const Step& step) {
  try {
    HeldWeights weights = step.kernel.hold();
    if (net.releasable.has(step.layer)) net.releasable.release(step.layer);
    return weights;
  } catch (const std::bad_alloc&) {
    throw MemoryError(str(net.file, ": layer '", net.graph.nodes[step.layer].name,
                          "': out of memory for ",
                          step.kernel.packed_floats * kFloatBytes / kMegabyte,
                          " MB of packed weights; lower PlanOptions::max_run_bytes"));
  }
}

}  // namespace

Plan Net::plan(const std::map<std::string, Shape>& inputs, const PlanOptions& options) const {
  check_threads(options.threads);
  const std::vector<Shape> shapes = shapes_for(*impl_, inputs);
  const std::vector<std::optional<DynamicRows>> rows = dynamic_rows(*impl_, shapes);
  check_weight_shapes(*impl_, shapes);
  auto [operations, schedule, placement] = make_draft_within_limit(*impl_, shapes, options);

  auto plan = std::make_shared<Plan::Impl>();
  plan->net = impl_;
  plan->flush_denormals = options.flush_denormals;
  plan->costs = describe_layers(*impl_, shapes);
  for (const LayerCost& cost : plan->costs) plan->weight_floats += cost.parameters;
  plan->packed_floats = schedule.packed_floats;
  plan->arena_floats = placement.arena_floats;
  plan->buffers = placement.buffers;
  check_run_memory(*impl_,
                   {plan->arena_floats, plan->packed_floats, plan->weight_floats, plan->buffers},
                   options.max_run_bytes);

  for (size_t s = 0; s < schedule.steps.size(); ++s) {
    ScheduledStep& scheduled = schedule.steps[s];
    count_step(scheduled, placement.runs[s], placement.new_floats[s],
               &plan->costs[scheduled.layer]);
    if (!placement.runs[s]) continue;
    Step step{scheduled.layer,      std::move(scheduled.kernel), {}, {},
              placement.scratch[s], placement.state[s]};
    for (const size_t id : scheduled.inputs) step.inputs.push_back(placement.stored[id]);
    for (const size_t id : scheduled.outputs) step.outputs.push_back(placement.stored[id]);
    if (step.kernel.name.find("gemm") != std::string::npos) plan->blas_threads = options.threads;
    if (impl_->has_weights && step.kernel.hold) step.weights = hold(*impl_, step);
    step.kernel.hold = nullptr;
    plan->steps.push_back(std::move(step));
  }
  name_absorbed(operations, &plan->costs);

  const Graph& graph = impl_->graph;
  const auto slot_of = [&](ValueId id) {
    const size_t stored = schedule.plain[operations.held_by[id]].value();
    return Plan::Impl::Slot{placement.stored[stored], schedule.stored[stored].shape, rows[id]};
  };
  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    if (impl_->nodes[i].layer) continue;
    for (const ValueId id : graph.nodes[i].outputs) {
      const Plan::Impl::Slot slot = slot_of(id);
      plan->inputs.push_back({graph.values[id].blob, slot.shape});
      plan->input_slots[graph.values[id].blob] = slot;
      plan->costs[i].activation_bytes += slot.shape.elements() * kFloatBytes;
    }
  }
  if (options.keep_all) {
    for (const Node& node : graph.nodes)
      for (size_t port = 0; port < node.outputs.size(); ++port)
        plan->layer_slots.try_emplace(port_name(node.name, port), slot_of(node.outputs[port]));
  }
  for (const Graph::Output& output : graph.outputs) {
    plan->output_slots.emplace(output.name, slot_of(output.value));
    plan->outputs.push_back({output.name, shapes[output.value]});
  }
  return Plan(std::move(plan));
}

const std::vector<LayerCost>& Plan::layers() const {
  return impl_->costs;
}
const std::vector<BufferUse>& Plan::buffers() const {
  return impl_->buffers;
}
const std::vector<Port>& Plan::inputs() const {
  return impl_->inputs;
}
const std::vector<Port>& Plan::outputs() const {
  return impl_->outputs;
}
int64_t Plan::arena_bytes() const {
  return impl_->arena_floats * kFloatBytes;
}
int64_t Plan::weight_bytes() const {
  return impl_->weight_floats * kFloatBytes;
}
int64_t Plan::packed_weight_bytes() const {
  return impl_->packed_floats * kFloatBytes;
}

}  // namespace revisit::engine
