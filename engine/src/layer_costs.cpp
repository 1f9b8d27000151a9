#include "layer_costs.h"

#include "receptive_field.h"

namespace revisit::engine {
namespace {

/// What each layer is, as the file has it; costs are still to be counted.
std::vector<LayerCost> describe_layers(const Graph& graph, const std::vector<Shape>& shapes) {
  std::vector<FieldHw> fields(graph.values.size());
  std::vector<size_t> producer(graph.values.size());  // node of each value
  std::vector<LayerCost> costs;
  for (size_t i = 0; i < graph.nodes.size(); ++i) {
    const Node& node = graph.nodes[i];
    LayerCost cost;
    cost.name = node.name;
    cost.type = node.param.type();
    cost.inputs = shapes_of(node.inputs, shapes);
    cost.outputs = shapes_of(node.outputs, shapes);
    for (const ValueId id : node.inputs) cost.input_layers.push_back(producer[id]);
    for (const ValueId id : node.outputs) {
      cost.blobs.push_back(graph.values[id].blob);
      producer[id] = i;
    }
    for (const Tensor& weight : node.weights) cost.parameters += weight.shape.elements();
    trace_field(node, &fields, &cost);
    costs.push_back(std::move(cost));
  }
  return costs;
}

void count_step(const Step& step, LayerCost* cost) {
  cost->activation_bytes += step.new_bytes;
  cost->packed_weight_bytes += step.kernel.packed.count;
  cost->macs += step.kernel.macs;
  const std::string name = step.kernel.joins_inputs && !step.runs ? "in place" : step.kernel.name;
  // A reorder only shows where its layer runs nothing else; a view runs nothing.
  if (cost->kernel.empty() || (!step.is_reorder && !name.empty())) cost->kernel = name;
  if (!step.is_reorder) cost->why = step.why;
}

}  // namespace

std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule) {
  std::vector<LayerCost> costs = describe_layers(net.graph, shapes);
  for (const Step& step : schedule.steps) count_step(step, &costs[step.layer]);
  // Every layer that another does the work of says which.
  for (const Operation& operation : operations.list)
    for (const size_t layer : operation.absorbed)
      costs[layer].kernel = "in " + costs[operation.node].name;
  size_t input = 0;  // of the net
  for (size_t i = 0; i < net.graph.nodes.size(); ++i)
    for (size_t port = 0; !net.graph.nodes[i].layer && port < costs[i].outputs.size(); ++port)
      costs[i].activation_bytes += schedule.stored[schedule.inputs[input++]].bytes;
  return costs;
}

}  // namespace revisit::engine
