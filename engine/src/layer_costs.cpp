#include <algorithm>

#include "plan_impl.h"

namespace revisit::engine {

Field field_through(const std::vector<Field>& inputs, const Window& window) {
  if (inputs.empty() || !inputs[0]) return std::nullopt;
  ReceptiveField joint = *inputs[0];
  for (const Field& input : inputs) {
    if (!input || input->stride != joint.stride) return std::nullopt;
    const int64_t end = std::max(joint.start + joint.size, input->start + input->size);
    joint.start = std::min(joint.start, input->start);
    if (__builtin_sub_overflow(end, joint.start, &joint.size)) return std::nullopt;
  }
  // One pixel of this layer's input is `joint.stride` pixels of the net's input.
  ReceptiveField out;
  if (__builtin_mul_overflow(joint.stride, window.stride, &out.stride) ||
      __builtin_mul_overflow(joint.stride, window.extent - 1, &out.size) ||
      __builtin_add_overflow(out.size, joint.size, &out.size) ||
      __builtin_mul_overflow(joint.stride, -window.pad, &out.start) ||
      __builtin_add_overflow(out.start, joint.start, &out.start))
    return std::nullopt;
  return out;
}

void trace_field(const Node& node, std::vector<FieldHw>* fields, LayerCost* cost) {
  FieldHw out;
  if (node.layer) {
    const auto window = node.inputs.empty() ? std::nullopt : node.layer->window(cost->inputs[0]);
    std::vector<Field> h, w;
    for (const ValueId id : node.inputs) {
      h.push_back((*fields)[id].h);
      w.push_back((*fields)[id].w);
    }
    out.h = window ? field_through(h, window->h) : std::nullopt;
    out.w = window ? field_through(w, window->w) : std::nullopt;
  }
  for (const ValueId id : node.outputs) (*fields)[id] = out;
  const size_t axes = cost->outputs.empty() ? 0 : cost->outputs[0].rank();
  if (axes >= 3) cost->field_w = out.w;
  if (axes >= 4) cost->field_h = out.h;
}

namespace {

std::vector<LayerCost> describe_layers(const Graph& graph, const std::vector<Shape>& shapes) {
  std::vector<FieldHw> fields(graph.values.size());
  std::vector<size_t> producer(graph.values.size());
  std::vector<LayerCost> costs;
  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    const Node& node = graph.nodes[i];
    LayerCost cost;
    cost.name = node.name;
    cost.type = node.param.type();
    cost.exact = !node.layer || node.layer->rounding() == Rounding::kNone;
    cost.inputs = shapes_of(node.inputs, shapes);
    cost.outputs = shapes_of(node.outputs, shapes);
    for (const ValueId id : node.inputs) {
      cost.input_blobs.push_back(graph.values[id].blob);
      cost.input_layers.push_back(producer[id]);
    }
    for (const ValueId id : node.outputs) {
      cost.blobs.push_back(graph.values[id].blob);
      producer[id] = i;
    }
    for (const Tensor& weight : *node.weights) {
      cost.weights.push_back(weight.shape);
      cost.parameters += weight.shape.elements();
    }
    trace_field(node, &fields, &cost);
    costs.push_back(std::move(cost));
  }
  return costs;
}

int64_t stored_bytes(const std::vector<size_t>& values, const Schedule& schedule) {
  int64_t bytes = 0;
  for (const size_t id : values) bytes += schedule.stored[id].bytes;
  return bytes;
}

/// Counts at most one weight per output value for kernels without products (Embed).
int64_t weight_bytes(const Step& step, int64_t written, const LayerCost& cost) {
  if (step.is_reorder) return 0;
  if (step.kernel.packed.count > 0) return step.kernel.packed.count;
  const int64_t all = floats(cost.parameters).count;
  return step.kernel.work.macs > 0 ? all : std::min(all, written);
}

void count_traffic(const Step& step, const Schedule& schedule, LayerCost* cost) {
  if (!step.runs) return;
  // Parts that are already in place are not moved.
  const bool moves_the_rest = step.kernel.aliasing == Aliasing::kCutsInput;
  const int64_t written = moves_the_rest ? step.new_bytes : stored_bytes(step.outputs, schedule);
  cost->written_bytes += written;
  cost->read_bytes += (moves_the_rest ? written : stored_bytes(step.inputs, schedule)) +
                      weight_bytes(step, written, *cost);
}

void count_step(const Step& step, LayerCost* cost) {
  cost->activation_bytes += step.new_bytes;
  cost->packed_weight_bytes += step.kernel.packed.count;
  const Work& work = step.kernel.work;
  cost->macs += work.macs;
  cost->multiplications += work.multiplications > 0 ? work.multiplications : work.macs;
  if (work.macs > 0) cost->products = work.products;
  cost->winograd |= step.kernel.name.starts_with("winograd");
  const bool joined = step.kernel.aliasing == Aliasing::kJoinsInputs && !step.runs;
  const std::string name = joined ? "in place" : step.kernel.name;
  // A reorder's name is used only if its layer has no other kernel. A view has none.
  if (cost->kernel.empty() || (!step.is_reorder && !name.empty())) cost->kernel = name;
  if (!step.is_reorder) cost->selection_reason = step.selection_reason;
}

}  // namespace

std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule) {
  std::vector<LayerCost> costs = describe_layers(net.graph, shapes);
  for (const Step& step : schedule.steps) {
    count_step(step, &costs[step.layer]);
    count_traffic(step, schedule, &costs[step.layer]);
  }
  for (const Operation& operation : operations.list)
    for (const size_t layer : operation.absorbed)
      costs[layer].kernel = "in " + costs[operation.node].name;
  size_t net_input = 0;
  for (size_t i = 0; i < net.graph.nodes.size(); ++i)
    for (size_t port = 0; !net.graph.nodes[i].layer && port < costs[i].outputs.size(); ++port)
      costs[i].activation_bytes += schedule.stored[schedule.inputs[net_input++]].bytes;
  return costs;
}

}  // namespace revisit::engine
