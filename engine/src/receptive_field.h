#pragma once

#include <optional>
#include <vector>

#include "graph.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// A value's receptive field along one axis; nothing: the whole input.
using Field = std::optional<ReceptiveField>;

/// Along rows and columns; of an input of the net itself.
struct FieldHw {
  Field h = ReceptiveField{}, w = ReceptiveField{};
};

/// The field of a layer's output from those of its inputs: the smallest interval that holds what
/// all of them see. Nothing when one of them sees everything or they have different strides.
Field field_through(const std::vector<Field>& inputs, const Window& window);

/// Sets `cost->field_h` and `field_w` where the first output has rows and columns. `node` has all
/// its fields; `fields` are those of all values before it, to which it adds its own.
void trace_field(const Node& node, std::vector<FieldHw>* fields, LayerCost* cost);

}  // namespace revisit::engine
