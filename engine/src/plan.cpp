#include <algorithm>
#include <limits>

#include "budget.h"
#include "memory_plan.h"
#include "plan_impl.h"
#include "receptive_field.h"

namespace revisit::engine {
namespace {

constexpr int64_t kAlignment = 16;  // floats: one cache line, one AVX-512 register

/// Decides which values share a buffer and how long each buffer lives.
class BufferPlanner {
 public:
  BufferPlanner(const Graph& graph, const std::vector<Shape>& shapes, bool keep_all)
      : graph_(graph),
        shapes_(shapes),
        last_use_(graph.values.size(), -1),
        buffer_of_(graph.values.size(), -1) {
    end_ = static_cast<int>(graph.nodes.size());
    for (int step = 0; step < end_; ++step)
      for (const ValueId id : graph.nodes[step].inputs) last_use_[id] = step;
    for (const Graph::Output& output : graph.outputs) last_use_[output.value] = end_;
    if (keep_all) std::fill(last_use_.begin(), last_use_.end(), end_);
  }

  /// Net inputs keep their values over forward passes: nothing ever shares their memory.
  void add_input(ValueId id) {
    last_use_[id] = end_;
    new_buffer(id, 0);
    buffers_[buffer_of_[id]].first = 0;
  }

  /// Returns how many bytes of new memory the outputs of this node take.
  int64_t add_node(int step, OutputMemory memory) {
    const Node& node = graph_.nodes[step];
    int64_t floats = 0;
    for (size_t port = 0; port < node.outputs.size(); ++port) {
      const ValueId output = node.outputs[port];
      if (memory == OutputMemory::kViewOfInput ||
          (memory == OutputMemory::kMayReuseInput && port == 0 &&
           is_last_use(node.inputs[0], step))) {
        share(output, node.inputs[0]);
      } else {
        new_buffer(output, step);
        floats += shapes_[output].elements();
      }
    }
    return floats * static_cast<int64_t>(sizeof(float));
  }

  int add_scratch(int step, int64_t floats) {
    buffers_.push_back({floats, step, step});
    return static_cast<int>(buffers_.size()) - 1;
  }

  /// Memory that nothing shares: it lasts from one forward pass to the next.
  int add_state(int64_t floats) {
    buffers_.push_back({floats, 0, end_});
    return static_cast<int>(buffers_.size()) - 1;
  }

  int buffer_of(ValueId id) const { return buffer_of_[id]; }
  const std::vector<Lifetime>& buffers() const { return buffers_; }

 private:
  void new_buffer(ValueId id, int step) {
    buffer_of_[id] = static_cast<int>(buffers_.size());
    buffers_.push_back({shapes_[id].elements(), step, std::max(step, last_use_[id])});
  }
  void share(ValueId id, ValueId with) {
    buffer_of_[id] = buffer_of_[with];
    Lifetime& buffer = buffers_[buffer_of_[id]];
    buffer.last = std::max(buffer.last, last_use_[id]);
  }
  /// Whether nothing reads the buffer of `id` after `step`, under any of the names it has.
  bool is_last_use(ValueId id, int step) const { return buffers_[buffer_of_[id]].last <= step; }

  const Graph& graph_;
  const std::vector<Shape>& shapes_;
  std::vector<int> last_use_;  // step; end_ for values that outlive the run
  std::vector<int> buffer_of_;
  std::vector<Lifetime> buffers_;
  int end_ = 0;
};

/// Weights belong to the shapes the net was loaded with; a reshape must not change what they are.
void check_weight_shapes(const std::vector<Shape>& wanted, const std::vector<Tensor>& weights) {
  for (size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i] != weights[i].shape)
      throw InputError(str("with these input shapes weight blob ", i, " would have to be ",
                           wanted[i], ", it is ", weights[i].shape,
                           "; choose another input shape or cut the net before this layer"));
}

/// Follows receptive fields and producers through the graph, node by node.
class Tracer {
 public:
  explicit Tracer(const Graph& graph)
      : graph_(graph), fields_(graph.values.size()), producer_(graph.values.size(), 0) {}

  void trace(size_t index, const Layer* layer, LayerCost* cost) {
    const Node& node = graph_.nodes[index];
    Fields out;
    if (!layer) {
      out = {ReceptiveField{}, ReceptiveField{}};
    } else if (!node.inputs.empty()) {
      if (const auto window = layer->window(cost->inputs[0])) {
        std::vector<Field> h, w;
        for (const ValueId id : node.inputs) {
          h.push_back(fields_[id].h);
          w.push_back(fields_[id].w);
        }
        out = {field_through(h, window->h), field_through(w, window->w)};
      }
    }
    for (const ValueId id : node.inputs) cost->input_layers.push_back(producer_[id]);
    for (const ValueId id : node.outputs) {
      fields_[id] = out;
      producer_[id] = index;
    }
    const bool is_image = !cost->outputs.empty() && cost->outputs[0].rank() >= 3;
    if (is_image) cost->field_w = out.w;
    if (is_image && cost->outputs[0].rank() >= 4) cost->field_h = out.h;
  }

 private:
  struct Fields {
    Field h, w;
  };
  const Graph& graph_;
  std::vector<Fields> fields_;    // of each value
  std::vector<size_t> producer_;  // node of each value
};

int64_t count_elements(const std::vector<Tensor>& weights) {
  int64_t elements = 0;
  for (const Tensor& weight : weights) elements += weight.shape.elements();
  return elements;
}

/// The arena for people: each buffer with the layer that first fills it.
std::vector<BufferUse> describe_buffers(const Graph& graph, const BufferPlanner& planner,
                                        const std::vector<int>& scratch_buffers,
                                        const std::vector<int>& state_buffers,
                                        const std::vector<Step>& steps, const MemoryPlan& memory) {
  std::vector<BufferUse> uses(planner.buffers().size());
  for (size_t i = graph.nodes.size(); i-- > 0;)  // backwards: the first to write gives the name
    for (const ValueId id : graph.nodes[i].outputs)
      uses[planner.buffer_of(id)].what = graph.nodes[i].name;
  for (size_t s = 0; s < steps.size(); ++s) {
    const std::string& name = graph.nodes[steps[s].layer].name;
    uses[scratch_buffers[s]].what = name + " (scratch)";
    uses[state_buffers[s]].what = name + " (state)";
  }
  constexpr auto kFloat = static_cast<int64_t>(sizeof(float));
  for (size_t b = 0; b < uses.size(); ++b) {
    const Lifetime& buffer = planner.buffers()[b];
    uses[b].offset_bytes = memory.offsets[b] * kFloat;
    uses[b].bytes = buffer.size * kFloat;
    uses[b].first_layer = static_cast<size_t>(buffer.first);
    uses[b].last_layer = static_cast<size_t>(buffer.last);
  }
  std::erase_if(uses, [](const BufferUse& use) { return use.bytes == 0; });
  return uses;
}

}  // namespace

Plan Net::plan(const std::map<std::string, Shape>& inputs, const PlanOptions& options) const {
  check_threads(options.threads);
  std::map<std::string, Shape> input_shapes;
  for (const Port& port : impl_->inputs) input_shapes[port.name] = port.shape;
  for (const auto& [blob, shape] : inputs) input_shapes.insert_or_assign(blob, shape);
  const std::vector<Shape> shapes = infer_shapes(*impl_, input_shapes);
  const std::vector<std::optional<DynamicRows>> rows = dynamic_rows(*impl_, shapes);
  const Graph& graph = impl_->graph;

  auto plan = std::make_shared<Plan::Impl>();
  plan->net = impl_;
  BufferPlanner planner(graph, shapes, options.keep_all);
  std::vector<int> scratch_buffers, state_buffers;  // as plan->steps
  Tracer tracer(graph);

  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    const Node& node = graph.nodes[i];
    const LoadedNode& loaded = impl_->nodes[i];
    LayerCost cost;
    cost.name = node.name;
    cost.type = node.param.type();
    for (const ValueId id : node.inputs) cost.inputs.push_back(shapes[id]);
    for (const ValueId id : node.outputs) {
      cost.outputs.push_back(shapes[id]);
      cost.blobs.push_back(graph.values[id].blob);
    }
    tracer.trace(i, loaded.layer.get(), &cost);
    cost.parameters = count_elements(loaded.weights);
    plan->weight_floats += cost.parameters;

    if (!loaded.layer) {
      for (const ValueId id : node.outputs) {
        planner.add_input(id);
        plan->inputs.push_back({graph.values[id].blob, shapes[id]});
        cost.activation_bytes += shapes[id].elements() * static_cast<int64_t>(sizeof(float));
      }
    } else {
      try {
        check_weight_shapes(loaded.layer->weight_shapes(cost.inputs), loaded.weights);
        const OutputMemory memory = loaded.layer->output_memory();
        cost.activation_bytes = planner.add_node(static_cast<int>(i), memory);
        if (memory != OutputMemory::kViewOfInput) {
          check_outputs(cost.outputs, options.max_arena_bytes);
          Step step{i,
                    loaded.layer->bind({cost.inputs, cost.outputs, loaded.weights,
                                        std::max(options.threads, 1), options.reference_kernels}),
                    {},
                    {},
                    0,
                    0};
          cost.kernel = step.kernel.name;
          cost.macs = step.kernel.macs;
          scratch_buffers.push_back(
              planner.add_scratch(static_cast<int>(i), step.kernel.scratch_floats));
          state_buffers.push_back(planner.add_state(step.kernel.state_floats));
          plan->steps.push_back(std::move(step));
        }
      } catch (const Error&) {
        rethrow_at(impl_->file, node);
      }
    }
    plan->costs.push_back(std::move(cost));
  }

  const MemoryPlan memory = plan_memory(planner.buffers(), kAlignment);
  plan->arena_floats = memory.total;
  plan->buffers =
      describe_buffers(graph, planner, scratch_buffers, state_buffers, plan->steps, memory);
  check_arena(*plan, options.max_arena_bytes);
  for (const Lifetime& buffer : planner.buffers()) plan->unshared_floats += buffer.size;
  const auto offset_of = [&](ValueId id) { return memory.offsets[planner.buffer_of(id)]; };
  for (size_t s = 0; s < plan->steps.size(); ++s) {
    Step& step = plan->steps[s];
    for (const ValueId id : graph.nodes[step.layer].inputs) step.inputs.push_back(offset_of(id));
    for (const ValueId id : graph.nodes[step.layer].outputs) step.outputs.push_back(offset_of(id));
    step.scratch = memory.offsets[scratch_buffers[s]];
    step.state = memory.offsets[state_buffers[s]];
  }
  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    if (impl_->nodes[i].layer) continue;
    for (const ValueId id : graph.nodes[i].outputs)
      plan->input_slots[graph.values[id].blob] = {offset_of(id), shapes[id], {}};
  }
  const auto slot_of = [&](ValueId id) {
    return Plan::Impl::Slot{offset_of(id), shapes[id], rows[id]};
  };
  if (options.keep_all) {
    for (const Node& node : graph.nodes)
      for (size_t port = 0; port < node.outputs.size(); ++port)
        plan->output_slots.try_emplace(port_name(node.name, port), slot_of(node.outputs[port]));
  }
  for (const Graph::Output& output : graph.outputs) {
    plan->output_slots.insert_or_assign(output.name, slot_of(output.value));
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
  return impl_->arena_floats * static_cast<int64_t>(sizeof(float));
}
int64_t Plan::unshared_activation_bytes() const {
  return impl_->unshared_floats * static_cast<int64_t>(sizeof(float));
}
int64_t Plan::weight_bytes() const {
  return impl_->weight_floats * static_cast<int64_t>(sizeof(float));
}

}  // namespace revisit::engine
