#pragma once

#include <optional>
#include <vector>

#include "graph.h"
#include "revisit/engine/net.h"
#include "schedule.h"

namespace revisit::engine {

std::vector<LayerCost> layer_costs(const Net::Impl& net, const std::vector<Shape>& shapes,
                                   const Operations& operations, const Schedule& schedule);

/// Receptive field of a value along one axis; nullopt: the entire input.
using Field = std::optional<ReceptiveField>;

/// Receptive fields along rows and columns; by default those of a net input.
struct FieldHw {
  Field h = ReceptiveField{}, w = ReceptiveField{};
};

/// Returns the field of a layer's output: the smallest interval that contains the fields of all
/// inputs. Returns nullopt if one of them is unbounded or strides differ.
Field field_through(const std::vector<Field>& inputs, const Window& window);

/// Sets `cost->field_h` and `field_w` if the first output has rows and columns. `cost` must have
/// the shapes; `fields` has those of all earlier values, and the node's outputs are added.
void trace_field(const Node& node, std::vector<FieldHw>* fields, LayerCost* cost);

}  // namespace revisit::engine
