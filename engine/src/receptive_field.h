#pragma once

#include <optional>
#include <vector>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// A value's receptive field along one axis; nothing: the whole input.
using Field = std::optional<ReceptiveField>;

/// The field of a layer's output from those of its inputs: the smallest interval that holds what
/// all of them see. Nothing when one of them sees everything or they have different strides.
Field field_through(const std::vector<Field>& inputs, const Window& window);

}  // namespace revisit::engine
