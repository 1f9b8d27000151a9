#pragma once

#include "layer.h"

namespace revisit::engine {

/// The kernel of a layer with what is fused to it: for layers whose `form` says all, a blocked
/// kernel when an input is blocked; else the layer's own.
Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding);

}  // namespace revisit::engine
