#pragma once

#include <memory>

#include "layer.h"
#include "revisit/engine/layer_types.h"

namespace revisit::engine {

/// The type of the inputs of a net, which are not layers here.
constexpr const char* kInputType = "Input";

bool is_supported(const std::string& type);

/// Throws UnsupportedError, saying what to do, for a type that `make_layer()` does not know.
void check_type(const caffe::LayerParameter& param);

/// The layer that `param.type()` names; null for kInputType. Throws UnsupportedError for an unknown
/// type, InputError for invalid parameters.
std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param);

/// How a layer is computed, and which fork computes its type differently, where the file does not
/// show whose it is; "" for all other layers.
std::string ambiguity_of(const caffe::LayerParameter& param);

}  // namespace revisit::engine
