#pragma once

#include "layer.h"

namespace revisit::engine {

/// The kernel of a layer with what is fused to it. Here and nowhere else is decided whether it is a
/// blocked one: for layers whose `form` says all, when an input is blocked. Else it is the layer's.
Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding);

}  // namespace revisit::engine
