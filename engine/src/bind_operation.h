#pragma once

#include "layer.h"

namespace revisit::engine {

/// Binds the kernel of a layer with its fused operations. Only this function selects NCHWc kernels:
/// if an input is NCHWc and `form` describes the layer completely. Otherwise it uses the layer's.
Kernel bind_operation(const Layer& layer, const Form& form, const Binding& binding);

}  // namespace revisit::engine
