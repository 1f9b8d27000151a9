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
  // One step of this layer's input is `joint.stride` pixels of the net's input.
  ReceptiveField out;
  if (__builtin_mul_overflow(joint.stride, window.stride, &out.stride) ||
      __builtin_mul_overflow(joint.stride, window.extent - 1, &out.size) ||
      __builtin_add_overflow(out.size, joint.size, &out.size) ||
      __builtin_mul_overflow(joint.stride, -window.pad, &out.start) ||
      __builtin_add_overflow(out.start, joint.start, &out.start))
    return std::nullopt;
  return out;
}

}  // namespace revisit::engine
