#pragma once

#include <memory>

#include "layer.h"
#include "revisit/engine/net.h"

namespace revisit::engine {

/// Type of net inputs, for which the engine has no layer.
constexpr const char* kInputType = "Input";

bool is_supported(const std::string& type);

/// Throws UnsupportedError with a fix for a type that `make_layer()` does not support.
void check_type(const caffe::LayerParameter& param);

/// Creates the layer of type `param.type()`; null for kInputType. Throws UnsupportedError for an
/// unknown type, InputError for invalid parameters.
std::unique_ptr<Layer> make_layer(const caffe::LayerParameter& param);

/// Returns the chosen interpretation and the fork with a different one, if the file cannot show
/// which fork's layer type it means; "" for all other layers.
std::string ambiguity_of(const caffe::LayerParameter& param);

}  // namespace revisit::engine
