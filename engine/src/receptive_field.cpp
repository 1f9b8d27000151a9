#include "receptive_field.h"

#include <algorithm>

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

}  // namespace revisit::engine
