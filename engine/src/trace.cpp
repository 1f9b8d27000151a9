#include "trace.h"

namespace revisit::engine {

Tracer::Tracer(const Graph& graph)
    : graph_(graph), fields_(graph.values.size()), producer_(graph.values.size(), 0) {}

void Tracer::trace(size_t index, const Layer* layer, LayerCost* cost) {
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

}  // namespace revisit::engine
