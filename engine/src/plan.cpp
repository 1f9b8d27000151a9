#include <algorithm>
#include <new>

#include "plan_impl.h"
#include "revisit/proto/net_file.h"
#include "schedule.h"

namespace revisit::engine {
namespace {

std::vector<Shape> shapes_for(const Net::Impl& net, const std::map<std::string, Shape>& inputs) {
  std::map<std::string, Shape> input_shapes;
  for (const Port& port : net.inputs) input_shapes[port.name] = port.shape;
  for (const auto& [blob, shape] : inputs) input_shapes.insert_or_assign(blob, shape);
  return infer_shapes(net, input_shapes);
}

/// Throws if the input shapes change the shapes of weights, which are fixed at loading.
void check_weight_shapes(const Net::Impl& net, const std::vector<Shape>& shapes) {
  for (const Node& node : net.graph.nodes) {
    if (!node.layer) continue;
    at_layer(net.file, node, [&] {
      const std::vector<Shape> wanted = node.layer->weight_shapes(shapes_of(node.inputs, shapes));
      for (size_t i = 0; i < wanted.size(); ++i)
        if (wanted[i] != (*node.weights)[i].shape)
          throw InputError("with these input shapes weight blob ", i, " needs shape ", wanted[i],
                           ", but it has ", (*node.weights)[i].shape,
                           "; choose another input shape or end the net before this layer");
    });
  }
}

std::map<std::string, ValueId> kept_values(const Net::Impl& net, const PlanOptions& options) {
  std::map<std::string, ValueId> all, kept;
  for (const Node& node : net.graph.nodes)
    for (size_t port = 0; port < node.outputs.size(); ++port)
      all.try_emplace(proto::port_name(node.name, port), node.outputs[port]);
  if (options.keep_all) return all;
  for (const std::string& name : options.keep) {
    const auto found = all.find(name);
    if (found == all.end())
      throw UsageError("keep: the (possibly truncated) net '", net.graph.name, "' has no layer '",
                       name, "'", nearest_name_hint(name, net.layer_names));
    kept.insert(*found);
  }
  return kept;
}

Operations rewrite(const Net::Impl& net, const std::vector<Shape>& shapes,
                   const PlanOptions& options, bool may_pack) {
  const bool merge = !options.keep_all && !options.reference_kernels;
  std::vector<ValueId> kept;
  for (const auto& [name, id] : kept_values(net, options)) kept.push_back(id);
  Operations operations = operations_of(net, shapes, kept);
  if (options.channel_offsets)
    fold_single_channel_input(net, shapes, *options.channel_offsets, &operations);
  // The rounding error of Winograd's transforms is small compared to bfloat16's.
  if (options.precision == Precision::kFloat32 || options.strict_accuracy)
    limit_rounding(options.strict_accuracy, net.sensitive, &operations);
  for (Operation& operation : operations.list)
    if (auto* const convolving = std::get_if<Convolving>(&operation.form))
      convolving->problem.values = options.precision;
  return merge ? fuse(std::move(operations), may_pack) : operations;
}

struct Draft {
  Operations operations;
  Schedule schedule;
};

Draft make_draft(const Net::Impl& net, const std::vector<Shape>& shapes, const PlanOptions& options,
                 bool may_pack) {
  Draft draft;
  draft.operations = rewrite(net, shapes, options, may_pack);
  draft.schedule = schedule(net, shapes, draft.operations, options, may_pack);
  place(net, &draft.schedule);
  return draft;
}

/// Uses the fastest kernels if they fit PlanOptions::max_run_bytes, else kernels without packed
/// weights. The decision assumes one thread, with the least scratch, so that results do not depend
/// on the number of threads.
Draft make_draft_within_limit(const Net::Impl& net, const std::vector<Shape>& shapes,
                              const PlanOptions& options) {
  PlanOptions one_thread = options;
  one_thread.threads = 1;
  Draft fastest = make_draft(net, shapes, one_thread, true);
  const bool fits =
      fastest.schedule.arena_bytes + fastest.schedule.packed_bytes <= options.max_run_bytes;
  return fits && options.threads == 1 ? fastest : make_draft(net, shapes, options, fits);
}

std::shared_ptr<const PackedWeights> hold(const Net::Impl& net, const Step& step) {
  try {
    return step.kernel.hold();
  } catch (const std::bad_alloc&) {
    throw MemoryError(net.file, ": layer '", net.graph.nodes[step.layer].name,
                      "': out of memory for ", step.kernel.packed.count / kMegabyte,
                      " MB of packed weights; lower the limit of a run");
  }
}

// Far above any use.
constexpr int kMaxThreads = 1024;

int64_t bytes_of(const Shape& shape) {
  return floats(shape.elements()).count;
}

}  // namespace

Plan Net::plan(const std::map<std::string, Shape>& inputs, const PlanOptions& options) const {
  check_threads(options.threads);
  const std::vector<Shape> shapes = shapes_for(*impl_, inputs);
  const std::vector<std::optional<DynamicRows>> rows = dynamic_rows(*impl_, shapes);
  check_weight_shapes(*impl_, shapes);
  Draft draft = make_draft_within_limit(*impl_, shapes, options);

  auto plan = std::make_shared<Plan::Impl>();
  plan->net = impl_;
  plan->flush_denormals = options.flush_denormals;
  plan->costs = layer_costs(*impl_, shapes, draft.operations, draft.schedule);
  for (const LayerCost& cost : plan->costs) plan->weight_bytes += floats(cost.parameters).count;
  plan->schedule = std::move(draft.schedule);
  check_run_memory(*plan, options.max_run_bytes);

  std::vector<Step>& steps = plan->schedule.steps;
  std::erase_if(steps, [](const Step& step) { return !step.runs; });
  for (Step& step : steps) {
    if (step.kernel.work.uses_blas) plan->blas_threads = options.threads;
    if (impl_->has_weights && step.kernel.hold) step.weights = hold(*impl_, step);
    step.kernel.hold = nullptr;
  }

  const Graph& graph = impl_->graph;
  const auto slot_of = [&](ValueId id) {
    const size_t stored = plan->schedule.nchw[draft.operations.held_by[id]].value();
    const Stored& place = plan->schedule.stored[stored];
    return Plan::Impl::Slot{place.offset, place.shape, rows[id]};
  };
  for (const Node& node : graph.nodes) {
    if (node.layer) continue;
    for (const ValueId id : node.outputs) {
      const Plan::Impl::Slot slot = slot_of(id);
      plan->inputs.push_back({graph.values[id].blob, slot.shape});
      plan->input_slots[graph.values[id].blob] = slot;
    }
  }
  for (const auto& [name, id] : kept_values(*impl_, options))
    plan->layer_slots.emplace(name, slot_of(id));
  for (const auto& [name, value] : graph.outputs) {
    plan->output_slots.emplace(name, slot_of(value));
    plan->outputs.push_back({name, shapes[value]});
  }
  return Plan(std::move(plan));
}

const std::vector<LayerCost>& Plan::layers() const {
  return impl_->costs;
}
const std::vector<BufferUse>& Plan::buffers() const {
  return impl_->schedule.buffers;
}
const std::vector<Port>& Plan::inputs() const {
  return impl_->inputs;
}
const std::vector<Port>& Plan::outputs() const {
  return impl_->outputs;
}
int64_t Plan::arena_bytes() const {
  return impl_->schedule.arena_bytes;
}
int64_t Plan::weight_bytes() const {
  return impl_->weight_bytes;
}
int64_t Plan::packed_weight_bytes() const {
  return impl_->schedule.packed_bytes;
}

void check_weight_bytes(const Net::Impl& net, int64_t limit) {
  int64_t bytes = 0;
  for (const Node& node : net.graph.nodes) {
    for (const Tensor& weight : *node.weights) bytes += bytes_of(weight.shape);
    if (bytes <= limit) continue;
    throw InputError(place_of(net.file, node), ": the weights up to here take ", bytes / kMegabyte,
                     " MB, more than the limit of ", limit / kMegabyte,
                     " MB (raise the limit of weights); check its num_output and kernel size");
  }
}

void check_outputs(const std::vector<Shape>& outputs, int64_t limit) {
  int64_t bytes = 0;
  for (const Shape& output : outputs) bytes += bytes_of(output);
  if (bytes > limit)
    throw InputError("its outputs take ", bytes / kMegabyte, " MB, more than the limit of ",
                     limit / kMegabyte,
                     " MB (raise the limit of a run); choose smaller input shapes");
}

void check_run_memory(const Plan::Impl& plan, int64_t limit) {
  const Schedule& schedule = plan.schedule;
  if (schedule.arena_bytes + schedule.packed_bytes <= limit) return;
  const auto largest =
      std::max_element(schedule.buffers.begin(), schedule.buffers.end(),
                       [](const BufferUse& a, const BufferUse& b) { return a.bytes < b.bytes; });
  throw InputError(plan.net->file, ": running the net takes ", schedule.arena_bytes / kMegabyte,
                   " MB for values and ", schedule.packed_bytes / kMegabyte,
                   " MB for packed weights, in addition to ", plan.weight_bytes / kMegabyte,
                   " MB of weights, more than the limit of ", limit / kMegabyte,
                   " MB (raise the limit of a run); the largest buffer is of '", largest->what,
                   "': ", largest->bytes / kMegabyte,
                   " MB; choose smaller input shapes or fewer threads");
}

void check_threads(int threads) {
  if (threads < 1) throw UsageError("expected at least 1 thread, found ", threads);
  if (threads > kMaxThreads)
    throw UsageError("expected at most ", kMaxThreads, " threads, found ", threads);
}

}  // namespace revisit::engine
