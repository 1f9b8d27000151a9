#pragma once

#include <memory>

#include "layer.h"
#include "revisit/engine/layer_types.h"

namespace revisit::engine {

/// The type of the inputs of a net, which are no layers here.
constexpr const char* kInputType = "Input";

/// The layer that `param.type()` names; null for kInputType. Throws UnsupportedError for a type we
/// lack, InputError for parameters that cannot be.
std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param);

}  // namespace revisit::engine
